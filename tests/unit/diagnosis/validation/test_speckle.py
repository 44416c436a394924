"""Laser speckle: contrast of the effect page, grain size of the aperture, log-normal law."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from starling.diagnosis.validation.camera import speckle
from starling.diagnosis.validation.camera.chain import ExposedPair
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.nominal import Nominal

SHAPE = (300, 400)


def _grain(camera: Nominal, contrast: float, cause: str = "left/speckle") -> np.ndarray:
    return speckle.grain(SHAPE, contrast, camera, Draws(seed=4, scene="a").scene_rng(cause))


@pytest.mark.parametrize("contrast", [0.03, 0.2, 0.5])
def test_mean_and_contrast(contrast: float, camera: Nominal) -> None:
    grain = _grain(camera, contrast)
    assert grain.mean() == pytest.approx(1.0, abs=4 * contrast / math.sqrt(grain.size / 2))
    assert grain.std() == pytest.approx(contrast, rel=0.02)
    assert grain.min() > 0


def test_speckle_is_log_normal(camera: Nominal) -> None:
    """The skewness is 3 C + C^3 for a log-normal law and 2 C for a gamma law."""
    grain = _grain(camera, 0.3)
    skewness = np.mean((grain - 1.0) ** 3) / 0.3**3
    assert skewness == pytest.approx(3 * 0.3 + 0.3**3, abs=0.05)


def test_grain_size_grows_with_the_f_number(camera: Nominal) -> None:
    def correlation(f_number: float | None) -> float:
        grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
        return float(np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1])

    assert abs(correlation(None)) < 0.01
    assert 0.02 < correlation(2.0) < correlation(4.0) < correlation(8.0) < 0.7


def test_neighbours_correlate_as_averages_of_fine_speckle(camera: Nominal) -> None:
    """Rationale: compare to speckle of a random pupil, averaged over pixels.

    There are 16 points per pixel. The coarse pupil causes an error of a few per cent.
    """
    fine, f_number = 16, 6.0
    width = 850e-9 * f_number / 3e-6 * fine  # lambda F [points].
    side = 1024
    frequency = np.fft.fftfreq(side)
    pupil = np.hypot(frequency[:, None], frequency[None, :]) < 0.5 / width
    rng = np.random.default_rng(0)
    correlations = []
    for _ in range(6):
        phases = np.exp(2j * np.pi * rng.random((side, side)))
        intensity = np.abs(np.fft.ifft2(pupil * phases)) ** 2
        pixels = intensity.reshape(side // fine, fine, side // fine, fine).mean((1, 3))
        correlations.append(np.corrcoef(pixels[:, 1:].ravel(), pixels[:, :-1].ravel())[0, 1])
    grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
    measured = np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1]
    assert measured == pytest.approx(np.mean(correlations), abs=0.04)


def test_imagers_have_different_speckle(camera: Nominal) -> None:
    left, right = _grain(camera, 0.3), _grain(camera, 0.3, "right/speckle")
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.02


def test_speckle_is_constant_over_frames(take) -> None:
    """Temporal means over two sets of frames are correlated because of the speckle."""

    def mean_image(frames: range, **values: float) -> np.ndarray:
        pairs: list[ExposedPair] = [take(frame=frame, shot_noise=0.3, **values) for frame in frames]
        return np.mean([pair.left for pair in pairs], axis=0)

    plain = mean_image(range(8))
    changes = [
        mean_image(half, laser_speckle=0.4) - plain for half in (range(8, 16), range(16, 24))
    ]
    assert np.corrcoef(changes[0].ravel(), changes[1].ravel())[0, 1] > 0.9
