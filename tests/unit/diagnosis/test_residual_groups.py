"""Groups of features that stay unexplained, in all scenes or in most."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.report import sentences
from starling.diagnosis.scenes.strata import COVARIATES
from starling.diagnosis.which.likelihood import Likelihood, size_by_scene
from starling.diagnosis.which.residuals import by_group, consistent_features, leads
from tests.unit.diagnosis.made_diagnosis import NAMED, segment_result
from tests.unit.diagnosis.test_features import GROUND

NAMES = ("level.x.left", "level.x.right", "dots.x.left", "dots.x.right", "holes", "time")


def residual(**groups: list[float]) -> np.ndarray:
    """Return residuals of four scenes; small ones in groups that are not given."""
    rows = np.full((4, len(NAMES)), 0.5)
    for number, name in enumerate(NAMES):
        first = name.partition(".")[0]
        if first in groups:
            rows[:, number] = groups[first]
    return rows


def test_groups_off_in_all_scenes_come_worst_first():
    assert leads(NAMES, residual(level=[4, 4, 5, 5], holes=[9, 9, 9, 9])) == (
        ("holes", "level by x"),
        (),
    )


def test_groups_that_vary_between_scenes_are_separate():
    rows = residual(dots=[9, -9, 8, -8], level=[4, 4, 4, 4])
    assert leads(NAMES, rows) == (("level by x",), ("dots by x",))


def test_a_single_scene_is_no_lead():
    assert leads(NAMES, residual(dots=[9, 0, 0, 0])) == ((), ())


def test_unknown_features_are_no_lead():
    rows = residual(level=[4, 4, 5, 5])
    rows[:, NAMES.index("time")] = np.nan
    rows[0, :2] = np.nan
    assert leads(NAMES, rows) == (("level by x",), ())


@pytest.mark.parametrize(
    ("common", "varying", "text"),
    [
        ((), (), "no single group of features"),
        (
            ("level", "right noise by y"),
            (),
            "brightness, pixel-to-pixel noise of the right image, by y",
        ),
        ((), ("holes by x",), "pixels without depth, by x, different in each scene"),
        (
            ("level",),
            ("dots",),
            "brightness; position and width of dots, different in each scene",
        ),
    ],
)
def test_a_lead_in_words(common, varying, text):
    assert sentences.lead(segment_result(NAMED, leads=(common, varying))) == text


def test_groups_and_scenes_add_up_to_the_size_of_a_gap():
    rows = residual(dots=[3, -3, 1, np.nan], level=[20, 1, 1, 1])
    weight = np.array([1.0, 0.5, 0.25, 1.0, 0.0, 2.0])
    gap = np.where(np.isfinite(rows), rows, np.nan)
    likelihood = Likelihood(gap, np.ones(gap.shape), weight)
    assert size_by_scene(rows, weight) == pytest.approx(
        likelihood.scene_sizes(likelihood.no_change)
    )
    parts = by_group(NAMES, rows, weight)
    assert sum(parts.values()) == pytest.approx(likelihood.size(likelihood.no_change))
    assert list(parts) == ["level by x", "dots by x", "time", "holes"]
    total_weight = 3 * 4.75 + 3.5
    assert parts["level by x"] == pytest.approx(1.5 * (100 + 3) / total_weight)
    assert parts["holes"] == 0


def test_consistent_features_are_off_in_the_same_direction_in_every_scene():
    """Not features that are unknown in one scene, or off by less than noise in one."""
    rows = residual(
        dots=[3, 4, 2, 3], holes=[-5, -6, -7, -8], time=[-4, 4, 4, 4], level=[9, 9, 9, 0.9]
    )
    rows[0, 3] = np.nan
    weight = np.full(len(NAMES), 0.5)
    expected = {"holes": [-5, -6, -7, -8], "dots.x.left": [3, 4, 2, 3]}
    assert consistent_features(NAMES, rows, weight) == expected


def test_feature_groups_know_all_covariates():
    assert list(GROUND.covariates) == COVARIATES
