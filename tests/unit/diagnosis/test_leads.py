"""What is left unexplained is named by groups: alike in all scenes, or in each otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.report import sentences
from starling.diagnosis.scenes.strata import COVARIATES
from starling.diagnosis.which.likelihood import Likelihood, by_scene
from starling.diagnosis.which.residuals import alike, by_group, leads
from tests.unit.diagnosis.made_diagnosis import NAMED, found
from tests.unit.diagnosis.test_features import GROUND

NAMES = ("level.x.left", "level.x.right", "dots.x.left", "dots.x.right", "holes", "time")


def left(**groups: list[float]) -> np.ndarray:
    """Four scenes; of groups not given a little."""
    table = np.full((4, len(NAMES)), 0.5)
    for number, name in enumerate(NAMES):
        first = name.partition(".")[0]
        if first in groups:
            table[:, number] = groups[first]
    return table


def test_what_is_off_alike_comes_worst_first():
    assert leads(NAMES, left(level=[4, 4, 5, 5], holes=[9, 9, 9, 9])) == (
        ("holes", "level by x"),
        (),
    )


def test_what_is_off_in_each_scene_otherwise_is_told_apart():
    table = left(dots=[9, -9, 8, -8], level=[4, 4, 4, 4])
    assert leads(NAMES, table) == (("level by x",), ("dots by x",))


def test_one_scene_alone_is_no_lead():
    assert leads(NAMES, left(dots=[9, 0, 0, 0])) == ((), ())


def test_what_is_not_known_is_no_lead():
    table = left(level=[4, 4, 5, 5])
    table[:, NAMES.index("time")] = np.nan
    table[0, :2] = np.nan
    assert leads(NAMES, table) == (("level by x",), ())


@pytest.mark.parametrize(
    ("alike", "each", "said"),
    [
        ((), (), "no single group of features"),
        (
            ("level", "right noise by y"),
            (),
            "brightness, noise from pixel to pixel of the right image, by y",
        ),
        ((), ("holes by x",), "pixels without depth, by x, in each scene otherwise"),
        (
            ("level",),
            ("dots",),
            "brightness; place and width of dots, in each scene otherwise",
        ),
    ],
)
def test_a_lead_in_words(alike, each, said):
    assert sentences.lead(found(NAMED, leads=(alike, each))) == said


def test_groups_and_scenes_are_parts_of_the_size_of_a_gap():
    table = left(dots=[3, -3, 1, np.nan], level=[20, 1, 1, 1])
    weight = np.array([1.0, 0.5, 0.25, 1.0, 0.0, 2.0])
    gap = np.where(np.isfinite(table), table, np.nan)
    told = Likelihood(gap, np.ones(gap.shape), weight)
    assert by_scene(table, weight) == pytest.approx(told.sizes(told.nothing))
    parts = by_group(NAMES, table, weight)
    assert sum(parts.values()) == pytest.approx(told.size(told.nothing))
    assert list(parts) == ["level by x", "dots by x", "time", "holes"]
    votes = 3 * 4.75 + 3.5
    assert parts["level by x"] == pytest.approx(1.5 * (100 + 3) / votes)
    assert parts["holes"] == 0


def test_what_is_off_the_same_way_in_every_scene():
    """Not what one scene does not know, nor what is off by less than noise in one."""
    table = left(
        dots=[3, 4, 2, 3], holes=[-5, -6, -7, -8], time=[-4, 4, 4, 4], level=[9, 9, 9, 0.9]
    )
    table[0, 3] = np.nan
    weight = np.full(len(NAMES), 0.5)
    assert alike(NAMES, table, weight) == {"holes": [-5, -6, -7, -8], "dots.x.left": [3, 4, 2, 3]}


def test_all_ways_to_part_a_scene_are_told_from_other_words():
    assert list(GROUND.covariates) == COVARIATES
