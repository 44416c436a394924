"""What is told of a fit: its gain on scenes held out, and its interval."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.which.fit import Fit, held_out
from starling.diagnosis.which.response import Signature
from tests.unit.diagnosis.made_gaps import FEATURES, ROOMS, SCENES, candidate

PLACES = np.linspace(0.0, 1.0, 1001)
STEP = 0.5e-3  # Half of one, by which an interval is wider.
BLUR = Signature(
    dataclasses.replace(candidate("lens_blur"), nodes=(1.0,)),
    (0.0, 1.0),
    np.zeros((2, SCENES, FEATURES)),
)
MIDDLES = 0.5 + np.array([-0.05, -0.1, -0.15, -0.2, 0.05, 0.1, 0.15, 0.2])


def fitted(cost: NDArray[np.float64]) -> Fit:
    """A fit of this cost (places, scenes)."""
    place = float(PLACES[cost.sum(axis=1).argmin()])
    return Fit(BLUR, place, np.zeros(SCENES), cost, PLACES)


def test_the_other_scenes_choose_what_a_scene_gains():
    """Each would choose the first for itself and gain; the second's choice costs it."""
    cost = np.array([[0.0, 10.0], [6.0, 0.0]])
    folds = [np.array([True, False]), np.array([False, True])]
    assert held_out(cost, np.array([5.0, 5.0]), folds).tolist() == [-1.0, -5.0]


@pytest.mark.parametrize("level, deviations", [(0.9, 1.645), (0.5, 0.6745)])
def test_of_scenes_that_agree_an_interval_is_that_of_one(level: float, deviations: float):
    """Eight scenes are no eight times as sure: what simulation gets wrong is the same in all."""
    cost = 0.5 * ((PLACES[:, None] - 0.5) / 0.05) ** 2 * np.ones(SCENES)
    half = deviations * 0.05 + STEP
    found = fitted(cost).interval(ROOMS, level=level)
    assert found == pytest.approx((0.5 - half, 0.5 + half), abs=1e-3)


def test_of_scenes_that_differ_an_interval_is_that_of_rooms_drawn_anew():
    """And wider where scenes of a room are alike."""
    cost = 1e6 * (PLACES[:, None] - MIDDLES) ** 2
    low, high = (float(end) for end in fitted(cost).interval(ROOMS, level=0.9))
    half = 1.645 * MIDDLES.std() / np.sqrt(SCENES)
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half), abs=0.012)
    rooms = [str(scene // 2) for scene in range(SCENES)]
    wider = [float(end) for end in fitted(cost).interval(rooms, level=0.9)]
    assert wider[1] - wider[0] > 1.15 * (high - low)
