"""Laser speckle: the page's contrast, grains of the aperture's size, another distribution."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from starling.diagnosis.validation.camera import speckle
from starling.diagnosis.validation.camera.chain import Pair
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.nominal import Nominal

SHAPE = (300, 400)


def _grain(camera: Nominal, contrast: float, cause: str = "left/speckle") -> np.ndarray:
    return speckle.grain(SHAPE, contrast, camera, Draws(seed=4, scene="a").of_scene(cause))


@pytest.mark.parametrize("contrast", [0.03, 0.2, 0.5])
def test_mean_and_contrast(contrast: float, camera: Nominal) -> None:
    grain = _grain(camera, contrast)
    assert grain.mean() == pytest.approx(1.0, abs=4 * contrast / math.sqrt(grain.size / 2))
    assert grain.std() == pytest.approx(contrast, rel=0.02)
    assert grain.min() > 0


def test_it_is_log_normal_and_not_gamma(camera: Nominal) -> None:
    """Third moment over the cube of the deviation: 3 C + C^3 of a log-normal, 2 C of a gamma."""
    grain = _grain(camera, 0.3)
    skewness = np.mean((grain - 1.0) ** 3) / 0.3**3
    assert skewness == pytest.approx(3 * 0.3 + 0.3**3, abs=0.05)


def test_grains_grow_with_the_aperture_number(camera: Nominal) -> None:
    def beside(f_number: float | None) -> float:
        grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
        return float(np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1])

    assert abs(beside(None)) < 0.01
    assert 0.02 < beside(2.0) < beside(4.0) < beside(8.0) < 0.7


def test_neighbours_correlate_as_averages_of_fine_speckle(camera: Nominal) -> None:
    """Rationale: speckle made the other way, from a random pupil, averaged over pixels.

    16 points to the pixel, one look; a coarse pupil leaves some per cent.
    """
    fine, f_number = 16, 6.0
    width = 850e-9 * f_number / 3e-6 * fine  # lambda F in fine points.
    side = 1024
    frequency = np.fft.fftfreq(side)
    pupil = np.hypot(frequency[:, None], frequency[None, :]) < 0.5 / width
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(6):
        phases = np.exp(2j * np.pi * rng.random((side, side)))
        intensity = np.abs(np.fft.ifft2(pupil * phases)) ** 2
        pixels = intensity.reshape(side // fine, fine, side // fine, fine).mean((1, 3))
        rows.append(np.corrcoef(pixels[:, 1:].ravel(), pixels[:, :-1].ravel())[0, 1])
    grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
    ours = np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1]
    assert ours == pytest.approx(np.mean(rows), abs=0.04)


def test_imagers_differ(camera: Nominal) -> None:
    left, right = _grain(camera, 0.3), _grain(camera, 0.3, "right/speckle")
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.02


def test_grain_stands_still_over_frames(take) -> None:
    """Temporal means of two halves agree far better with grain than without reason to."""

    def mean_of(frames: range, **values: float) -> np.ndarray:
        pairs: list[Pair] = [take(frame=frame, shot_noise=0.3, **values) for frame in frames]
        return np.mean([pair.left for pair in pairs], axis=0)

    plain = mean_of(range(8))
    moved = [mean_of(half, laser_speckle=0.4) - plain for half in (range(8, 16), range(16, 24))]
    assert np.corrcoef(moved[0].ravel(), moved[1].ravel())[0, 1] > 0.9
