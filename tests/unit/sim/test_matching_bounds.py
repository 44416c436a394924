"""Ends of the disparity search and the border of the overlap, just inside and just outside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.sim.reason import Reason
from starling.sim.sensor.matcher import D4XX
from starling.sim.stereo import checks
from starling.sim.stereo.matching import DisparityMap, match
from tests.unit.sim.test_matching import shifted_pair

SEARCH_PX = 32
INNER = (slice(8, -8), slice(60, -40))  # Far from image borders.


def matched(shift: int) -> DisparityMap:
    return match(*shifted_pair(shift), replace(D4XX, search_px=SEARCH_PX))


@pytest.mark.parametrize("shift", [0, SEARCH_PX - 1])
def test_a_match_at_an_end_of_the_search_is_ambiguous(shift: int) -> None:
    """The best cost may lie beyond the end."""
    assert (matched(shift).reason[INNER] == Reason.AMBIGUOUS).mean() > 0.99


@pytest.mark.parametrize("shift", [2, SEARCH_PX - 3])
def test_a_match_inside_the_search_is_valid(shift: int) -> None:
    """Two pixels inside: smoothing keeps neighbours off the end."""
    assert matched(shift).valid[INNER].mean() > 0.99


@pytest.mark.parametrize(("disparity_px", "outside"), [(4.99, False), (5.01, True)])
def test_a_match_left_of_the_right_image_is_outside(disparity_px: float, outside: bool) -> None:
    """Column 5 matches column 0 of the right image at 5 px."""
    disparity = np.full((1, 40), disparity_px, np.float32)
    assert checks.outside_overlap(disparity, reach_px=16)[0, 5] == outside


@pytest.mark.parametrize(("border_px", "outside"), [(1.9, False), (2.1, True)])
def test_the_border_excludes_further_columns(border_px: float, outside: bool) -> None:
    """Column 7 matches column 2 of the right image at 5 px."""
    disparity = np.full((1, 40), 5.0, np.float32)
    mask = checks.outside_overlap(disparity, reach_px=16, border_px=border_px)
    assert mask[0, 7] == outside
