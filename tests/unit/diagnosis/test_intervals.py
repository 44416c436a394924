"""Held-out gain and interval of a fit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.which.fit import Fit, held_out_gain
from starling.diagnosis.which.response import Signature
from tests.unit.diagnosis.made_gaps import FEATURES, ROOMS, SCENES, candidate

PLACES = np.linspace(0.0, 1.0, 1001)
HALF_STEP = 0.5e-3  # An interval extends by half a step at each end.
BLUR = Signature(
    dataclasses.replace(candidate("lens_blur"), nodes=(1.0,)),
    (0.0, 1.0),
    np.zeros((2, SCENES, FEATURES)),
)
CENTRES = 0.5 + np.array([-0.05, -0.1, -0.15, -0.2, 0.05, 0.1, 0.15, 0.2])


def fit_with(cost: NDArray[np.float64]) -> Fit:
    """Return a fit with a given cost (places, scenes)."""
    place = float(PLACES[cost.sum(axis=1).argmin()])
    return Fit(BLUR, place, np.zeros(SCENES), cost, PLACES)


def test_the_other_scenes_choose_the_value_of_a_held_out_scene():
    """Each scene would gain by its own choice; the choice of the other scene costs it."""
    cost = np.array([[0.0, 10.0], [6.0, 0.0]])
    folds = [np.array([True, False]), np.array([False, True])]
    assert held_out_gain(cost, np.array([5.0, 5.0]), folds).tolist() == [-1.0, -5.0]


@pytest.mark.parametrize("level, deviations", [(0.9, 1.645), (0.5, 0.6745)])
def test_scenes_that_agree_have_the_interval_of_one(level: float, deviations: float):
    """Model error is common to the eight scenes, so that they do not narrow the interval."""
    cost = 0.5 * ((PLACES[:, None] - 0.5) / 0.05) ** 2 * np.ones(SCENES)
    half = deviations * 0.05 + HALF_STEP
    ends = fit_with(cost).interval(ROOMS, level=level)
    assert ends == pytest.approx((0.5 - half, 0.5 + half), abs=1e-3)


def test_scenes_that_differ_have_a_bootstrap_interval_over_rooms():
    """It is wider if two similar scenes share a room."""
    cost = 1e6 * (PLACES[:, None] - CENTRES) ** 2
    low, high = (float(end) for end in fit_with(cost).interval(ROOMS, level=0.9))
    half = 1.645 * CENTRES.std() / np.sqrt(SCENES)
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half), abs=0.012)
    rooms = [str(scene // 2) for scene in range(SCENES)]
    shared = [float(end) for end in fit_with(cost).interval(rooms, level=0.9)]
    assert shared[1] - shared[0] > 1.15 * (high - low)
