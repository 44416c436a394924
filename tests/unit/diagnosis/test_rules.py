"""Rules are learned in half of the rooms and measured in the other half."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.where import rules
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

LEFT = GROUND.covariates["x"].mask("left")


def gap(seed: int, share: float) -> np.ndarray:
    """Return holes in the left third of the image."""
    return LEFT & (np.random.default_rng(seed).random(DISPARITY.shape) < share)


def test_figures_of_a_rule_come_from_the_other_rooms():
    """The gap is 30 points in the learning rooms and 20 points in the measuring rooms."""
    scenes = 8
    nothing = [np.zeros(DISPARITY.shape, bool)] * scenes
    holes = [gap(scene, (0.3, 0.2)[scene % 2]) for scene in range(scenes)]
    rooms = [str(scene) for scene in range(scenes)]
    rule, *_ = rules.find_rules(nothing, holes, [GROUND] * scenes, rooms)
    area = LEFT[GROUND.counted].mean()
    assert rule.area == pytest.approx(area, abs=0.02)
    assert rule.gap == pytest.approx(0.2, abs=0.02)
    assert rule.net == pytest.approx(0.2 * area, abs=0.01)
    assert rule.share == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("area", "reported"), [(0.31, True), (0.36, False)])
def test_a_rule_covers_at_most_a_third_of_the_pixels(area: float, reported: bool):
    scenes = 4
    x = GROUND.covariates["x"].value
    assert x is not None
    where = x < np.quantile(x[GROUND.counted], area)
    random = np.random.default_rng(0)
    holes = [where & (random.random(DISPARITY.shape) < 0.3) for _ in range(scenes)]
    nothing = [np.zeros(DISPARITY.shape, bool)] * scenes
    rooms = [str(scene) for scene in range(scenes)]
    reports = rules.find_rules(nothing, holes, [GROUND] * scenes, rooms)
    assert [rule.area for rule in reports] == ([pytest.approx(area, abs=0.01)] if reported else [])
