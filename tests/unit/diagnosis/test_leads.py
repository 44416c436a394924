"""What is left unexplained is named by groups: alike in all scenes, or in each otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.report import sentences
from diagnosis.which.arm import leads
from tests.unit.diagnosis.test_report import NAMED, found

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
        (("level", "holes"), (), "level, holes"),
        ((), ("dots by x",), "dots by x, in each scene otherwise"),
        (("level",), ("dots by x",), "level; dots by x, in each scene otherwise"),
    ],
)
def test_a_lead_in_words(alike, each, said):
    assert sentences.lead(found(NAMED, leads=(alike, each))) == said
