"""Noise of images: choice of repeats, and bound from single images."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.observation import Observation
from starling.calibration.photometry.noise import fit_noise, noise_bound_dn
from starling.calibration.photometry.photon_transfer import fit_photon_transfer
from starling.calibration.photometry.prediction import Prediction
from starling.patterns.errors import InputError
from tests.unit.calibration.lit_table import INFO
from tests.unit.calibration.test_photon_transfer import repeats, sensor_with


def test_noise_is_fitted_to_the_scene_with_most_frames() -> None:
    truth = sensor_with(bit_depth=8, read_noise_e=90.0, black_level_dn=9.0)
    noisier = dataclasses.replace(truth.left, read_noise_e=200.0)
    scenes = [
        Observation(name=name, room=name, info=INFO, repeats=repeats(part, count=count))
        for name, part, count in (("two", noisier, 2), ("four", truth.left, 4), ("2", noisier, 2))
    ]
    result = fit_noise(scenes, (), truth)
    repeated = scenes[1].repeats
    assert repeated is not None
    expected = fit_photon_transfer(repeated, truth)
    assert [estimate.value for estimate in result.estimates[:3]] == [
        estimate.value for estimate in expected.estimates
    ]


def test_copies_of_a_frame_are_refused_with_their_scene() -> None:
    truth = sensor_with(bit_depth=8)
    copies = np.repeat(repeats(truth.left, count=1), 2, axis=0)
    scene = Observation(name="desk", room="a", info=INFO, repeats=copies)
    with pytest.raises(InputError, match=r"^scene desk: repeats must differ"):
        fit_noise([scene], (), truth)


def test_the_noise_s_bound_is_that_at_the_median_level() -> None:
    """Noise of 2 % of a level from 0 to 200 DN is about 2 DN at the median level."""
    rng = np.random.default_rng(0)
    level = np.broadcast_to(np.linspace(0, 200, 320, dtype=np.float32), (192, 320))
    noise = (0.02 * level * rng.standard_normal(level.shape)).astype(np.float32)
    prediction = Prediction(
        side="left",
        on=True,
        level_dn=level + noise,
        signal_dn=level,
        sharp_laser_dn=np.zeros_like(level),
        residual_dn=noise,
        used=np.ones(level.shape, bool),
        dots=True,
    )
    assert 2.0 * 0.85 < noise_bound_dn(prediction) < 3.0
    assert noise_bound_dn(dataclasses.replace(prediction, residual_dn=2 * noise)) == pytest.approx(
        2 * noise_bound_dn(prediction)
    )
