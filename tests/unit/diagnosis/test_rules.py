"""Rules of where a gap is: learnt in half of the rooms, told by the other half."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.where import rules
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

LEFT = GROUND.covariates["x"].where("left")


def gap(seed: int, share: float) -> np.ndarray:
    """Holes in the left third alone."""
    return LEFT & (np.random.default_rng(seed).random(DISPARITY.shape) < share)


def test_a_rules_figures_are_those_of_the_rooms_that_it_was_not_learnt_from():
    """Of a gap of 30 points where it was learnt, and of 20 where it is told."""
    scenes = 8
    nothing = [np.zeros(DISPARITY.shape, bool)] * scenes
    holes = [gap(scene, (0.3, 0.2)[scene % 2]) for scene in range(scenes)]
    rooms = [str(scene) for scene in range(scenes)]
    rule, *_ = rules.rules(nothing, holes, [GROUND] * scenes, rooms)
    area = LEFT[GROUND.counted].mean()
    assert rule.area == pytest.approx(area, abs=0.02)
    assert rule.gap == pytest.approx(0.2, abs=0.02)
    assert rule.net == pytest.approx(0.2 * area, abs=0.01)
    assert rule.share == pytest.approx(1.0, abs=0.05)
