"""Correlated temporal noise: its law, its variance after averaging, and its independence."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import special

from starling.patterns.errors import InputError
from starling.sim.imaging import imager
from starling.sim.imaging.imager import converter, noise, noise_colour
from starling.sim.imaging.imager.charge import Side
from starling.sim.sensor.sensor import Imager

PART = Imager(
    shot_noise=1.0, read_noise_e=20.0, full_well_e=65535.0, black_level_dn=2000.0, bit_depth=16
)
LIGHT = np.full((400, 500), 3000.0, np.float32)


def seen(part: Imager, frame: int = 0, side: Side = "left") -> np.ndarray:
    read = imager.read_out(
        part,
        LIGHT,
        exposure_s=0.01,
        unit=0,
        side=side,
        seed=1,
        frame=frame,
    )
    return read.delivered.astype(float) - 5000


def alike(image: np.ndarray, down: int, right: int) -> float:
    """Correlation of pixels that are rows and columns apart."""
    height, width = image.shape
    shifted = image[down:, right:] * image[: height - down, : width - right]
    return float(shifted.mean() / image.var())


@pytest.mark.parametrize("correlation", [0.1, 0.5, 0.8])
def test_noise_correlates_by_the_law_at_equal_variance(correlation: float) -> None:
    image = seen(dataclasses.replace(PART, noise_correlation=correlation))
    assert image.var() == pytest.approx(3000 + 20**2, rel=0.03)
    assert abs(image.mean()) < 2
    for places in ((0, 1), (1, 0)):
        assert alike(image, *places) == pytest.approx(correlation, abs=0.02)
    assert alike(image, 1, 1) == pytest.approx(correlation**2, abs=0.02)
    variance = noise_colour._variance(correlation)
    second = special.ive(2, 2 * variance) / special.ive(0, 2 * variance)
    assert alike(image, 0, 2) == pytest.approx(second, abs=0.02)


def test_borders_have_the_same_variance() -> None:
    draws = [noise_colour.draw(np.random.default_rng(seed), (40, 60), 0.8) for seed in range(400)]
    deviation = np.std(draws, axis=0)
    border = np.concatenate([deviation[0], deviation[-1], deviation[:, 0], deviation[:, -1]])
    assert border.mean() == pytest.approx(1, abs=0.02)
    assert deviation[10:-10, 10:-10].mean() == pytest.approx(1, abs=0.02)


def test_frames_and_imagers_are_independent() -> None:
    part = dataclasses.replace(PART, noise_correlation=0.6)
    first = seen(part)
    for image in (seen(part, frame=1), seen(part, side="right")):
        assert abs(np.corrcoef(first.ravel(), image.ravel())[0, 1]) < 0.02
    assert np.array_equal(first, seen(part))


def test_white_noise_is_that_without_the_key() -> None:
    """The same draw, so that images stay bit for bit."""
    rng, again = np.random.default_rng(3), np.random.default_rng(3)
    white = noise_colour.draw(rng, (20, 30), 0.0)
    assert np.array_equal(white, again.standard_normal((20, 30), np.float32))
    assert np.array_equal(noise_colour.weights(0.0), [1.0])


@pytest.mark.parametrize("mosaic", ["none", "rggb"])
@pytest.mark.parametrize("smoothing_px", [0.0, 0.8])
def test_the_stated_deviation_knows_the_correlation(mosaic: str, smoothing_px: float) -> None:
    """Averaging reduces correlated noise less. Offsets of pixels stay independent."""
    part = dataclasses.replace(
        PART,
        noise_correlation=0.5,
        dsnu_e=15.0,
        mosaic=mosaic,
        smoothing_px=smoothing_px,
    )
    stated = float(noise.noise_e(part, LIGHT, 0.01).mean())
    assert seen(part).std() == pytest.approx(stated, rel=0.02)
    white = noise.noise_e(dataclasses.replace(part, noise_correlation=0.0), LIGHT, 0.01).mean()
    assert stated > 1.1 * white or (mosaic, smoothing_px) == ("none", 0.0)


def test_shares_of_white_noise_are_exact() -> None:
    assert converter.pixel_variance_share("none", 0.7) == 1.0
    assert converter.pixel_variance_share("none", 0.0, 0.5) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("value", [-0.1, 0.95])
def test_impossible_correlations_are_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"^imager.noise_correlation must be in \[0, 0.9\]"):
        Imager(noise_correlation=value)
