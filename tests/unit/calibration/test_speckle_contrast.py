"""Speckle contrast of synthetic dots after crosstalk, averaging and noise.

The prediction is the exact mean. The tests do not cover errors of the geometry.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.calibration.photometry.prediction import Prediction
from starling.calibration.photometry.speckle_contrast import fit_speckle, speckle_bound
from starling.sim.imaging import imager
from starling.sim.imaging.optics import speckle
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

BASE = presets.load("d435")
SHAPE = (192, 320)
DOT_PX = 1.0  # Sigma.
PEAK_DN = 60.0
AMBIENT_DN = 20.4


def sensor_with(**changes: float) -> Sensor:
    part = dataclasses.replace(BASE.left, auto_exposure_level=0.0, prnu=0.0, **changes)
    return dataclasses.replace(BASE, left=part, right=part)


def captured(sensor: Sensor, contrast: float, *, seed: int = 0) -> Prediction:
    """Return an image of random dots under uniform ambient light, with its exact mean."""
    part, rng = sensor.left, np.random.default_rng(seed)
    dots = (rng.random(SHAPE) < 0.02).astype(np.float32)
    laser = cv2.GaussianBlur(dots, (0, 0), DOT_PX) * np.float32(PEAK_DN * 2 * np.pi * DOT_PX**2)
    grain_px = speckle.grain_size_px(
        wavelength_nm=sensor.projector.wavelength_nm,
        f_number=part.lens.f_number,
        pixel_pitch_m=part.pixel_pitch_m,
    )
    grained = laser * speckle.draw_speckle(SHAPE, contrast=contrast, grain_px=grain_px, rng=rng)
    codes = imager.read_out(
        part,
        (grained + np.float32(AMBIENT_DN)) / np.float32(part.dn_per_electron),
        exposure_s=part.exposure_s,
        unit=0,
        side="left",
        seed=seed,
        frame=0,
    ).delivered
    mean = imager.mix_pixels(part, laser + np.float32(AMBIENT_DN))
    level = codes.astype(np.float32)
    return Prediction(
        side="left",
        on=True,
        level_dn=level,
        signal_dn=mean,
        sharp_laser_dn=laser,
        residual_dn=level - np.float32(part.black_level_dn) - mean,
        used=np.ones(SHAPE, bool),
        dots=True,
    )


@pytest.mark.parametrize("crosstalk", [0.0, 0.2])
@pytest.mark.parametrize("smoothing_px", [0.0, 0.68])
def test_contrast_is_independent_of_crosstalk_and_averaging(
    smoothing_px: float, crosstalk: float
) -> None:
    """The estimate is within 3 %, although averaging attenuates dots and speckle."""
    sensor = sensor_with(smoothing_px=smoothing_px, crosstalk=crosstalk)
    estimate = fit_speckle([captured(sensor, 0.25, seed=seed) for seed in range(4)], sensor)
    assert estimate is not None and np.isfinite(estimate.sd)
    assert estimate.value == pytest.approx(0.25, rel=0.03)


@pytest.mark.parametrize(
    "changes",
    [{}, {"smoothing_px": 1.0}, {"smoothing_px": 0.68, "shot_noise": 0.0}],
)
def test_the_bound_uses_the_expected_noise(changes: dict[str, float]) -> None:
    """The bound is 0.05 to 0.2 for a contrast of 0.05, whose speckle is at most the noise."""
    sensor = sensor_with(**changes)
    bound = speckle_bound([captured(sensor, 0.05, seed=seed) for seed in range(2)], sensor)
    assert 0.05 <= bound < 0.2
