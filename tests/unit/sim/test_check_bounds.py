"""Bounds of the matcher's checks: the last accepted value and the first refused one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.reason import Reason
from starling.sim.sensor.matcher import (
    D4XX,
    FAST,
    Block,
    CensusSemiGlobal,
    Checks,
    Matcher,
    SemiGlobalBlock,
)
from starling.sim.stereo import census, checks, matching, opencv, support
from starling.sim.stereo.matching import LEAST_PX, TEN_BITS, match, readable
from starling.sim.stereo.semiglobal import Winners
from tests.unit.sim.test_matching import _slow_cost as slow_cost
from tests.unit.sim.test_matching import shifted_pair

NAN = np.float32(np.nan)


def test_texture_is_that_of_a_window_of_15_px() -> None:
    image = np.full((41, 41), 20, np.uint8)
    image[20, 20] = 120
    accepted = np.zeros(image.shape, bool)
    accepted[13:28, 13:28] = True
    np.testing.assert_array_equal(~checks.texture(checks.moments(image)[1], least_dn=0.1), accepted)


@pytest.mark.parametrize(("least_dn", "rejected"), [(1.99, False), (2.01, True)])
def test_texture_is_a_standard_deviation(least_dn: float, rejected: bool) -> None:
    """A chequerboard of 10 +- 2 DN deviates by 2 DN."""
    board = (8 + 4 * (np.indices((31, 31)).sum(axis=0) % 2)).astype(np.uint8)
    for image in (board, board.astype(np.uint16) * 4):
        refused = checks.texture(checks.moments(image)[1], least_dn=least_dn)
        assert (refused[8:-8, 8:-8] == rejected).all()


@pytest.mark.parametrize(("height_px", "rejected"), [(3.0, False), (3.1, True)])
def test_a_step_of_the_allowed_range_is_no_edge(height_px: float, rejected: bool) -> None:
    step = np.full((9, 12), 5, np.float32)
    step[:, 6:] += np.float32(height_px)
    mask = checks.jump(step, range_px=3.0)
    expected = np.zeros(step.shape, bool)
    expected[:, 5:7] = rejected
    np.testing.assert_array_equal(mask, expected)


def test_a_hole_is_no_edge() -> None:
    slope = np.tile(np.arange(12, dtype=np.float32), (9, 1))
    slope[4, 5] = np.nan
    assert not checks.jump(slope, range_px=2.0).any()
    mask = checks.jump(slope, range_px=1.9)
    assert mask[:, 1:-1].sum() == 9 * 10 - 1 and not mask[4, 5] and not mask[:, [0, -1]].any()
    assert not checks.jump(np.full((4, 4), NAN), range_px=1.0).any()


@pytest.mark.parametrize(("pixels", "removed"), [(6, True), (7, False)])
def test_an_island_of_the_count_is_removed(pixels: int, removed: bool) -> None:
    field = np.full((12, 20), 5, np.float32)
    field[5, 4 : 4 + pixels] = 9
    mask = checks.speckle(field, count=6, step_px=1.0)
    np.testing.assert_array_equal(mask, (field == 9) & removed)


@pytest.mark.parametrize(("step_px", "removed"), [(1.0, False), (1.0625, True)])
def test_an_island_is_bounded_by_larger_steps(step_px: float, removed: bool) -> None:
    """Disparities are compared in sixteenths of a pixel."""
    field = np.full((12, 20), 5, np.float32)
    field[5, 4:8] += np.float32(step_px)
    field[0, 0] = np.nan
    mask = checks.speckle(field, count=6, step_px=1.0)
    np.testing.assert_array_equal(mask, (field > 5) & removed)


@pytest.mark.parametrize("disparity_px", [0.0, 0.5, 1.0, 16.0])
def test_no_disparity_is_a_speckle_by_its_value(disparity_px: float) -> None:
    """The marker of missing disparities is distinct from every disparity."""
    field = np.full((12, 20), disparity_px, np.float32)
    field[3, 3] = np.nan
    assert not checks.speckle(field, count=6, step_px=1.0).any()


@pytest.mark.parametrize(("tolerance_px", "rejected"), [(1.0, False), (0.99, True)])
def test_a_difference_of_the_tolerance_agrees(tolerance_px: float, rejected: bool) -> None:
    left, right = np.full((2, 12), 4, np.float32), np.full((2, 12), 5, np.float32)
    mask = checks.left_right(left, right, tolerance_px=tolerance_px)
    assert (mask[:, 4:] == rejected).all()
    assert not mask[:, :4].any()  # These point outside the image.


def test_the_match_is_the_nearest_column_of_the_right_view() -> None:
    """Only column 3 of the right view has the left view's disparity."""
    right = np.full((1, 12), 9, np.float32)
    right[0, 3] = 4
    for disparity_px, column in ((3.6, 7), (4.4, 7), (4.6, 8), (3.4, 6)):
        mask = checks.left_right(np.full((1, 12), disparity_px), right, tolerance_px=1.0)
        assert np.flatnonzero(~mask[0, 5:]).tolist() == [column - 5]


def test_no_match_in_the_right_view_disagrees() -> None:
    left, right = np.zeros((1, 6), np.float32), np.zeros((1, 6), np.float32)
    right[0, 2] = -0.5
    assert np.flatnonzero(checks.left_right(left, right, tolerance_px=2.0)).tolist() == [2]
    left[0, 5] = -1.0  # Points one column beyond the right image.
    assert not checks.left_right(left, right, tolerance_px=0.5)[0, 5]


@pytest.mark.parametrize(("column", "outside"), [(31, True), (32, False)])
def test_a_hole_takes_its_disparity_within_twice_the_reach(column: int, outside: bool) -> None:
    """The search for the next disparity to the right ends at twice the search range."""
    disparity = np.full((1, 64), NAN)
    disparity[0, column] = 16.0
    mask = checks.outside_overlap(disparity, reach_px=16)
    assert mask[0, :16].all() == outside and mask[0, :16].any() == outside
    assert not mask[0, 16:].any()


@pytest.mark.parametrize(
    ("step_px", "width_px", "disagree"),
    [(1.0, 3, False), (1.1, 3, True), (2.0, 6, True), (2.0, 7, False), (-2.0, 2, False)],
)
def test_an_occlusion_is_about_as_wide_as_its_step(
    step_px: float, width_px: int, disagree: bool
) -> None:
    """The step exceeds 1 px, and the hole is at most 2 px wider than twice the step."""
    row = np.full((1, 30), 50, np.float32)  # Only the two neighbours of the hole count.
    row[0, 7] = 10
    row[0, 8 : 8 + width_px] = np.nan
    row[0, 8 + width_px] = 10 + np.float32(step_px)
    masks = opencv._causes(row)
    np.testing.assert_array_equal(masks[0], np.isnan(row) & disagree)
    np.testing.assert_array_equal(masks[1], np.isnan(row) & (not disagree))


def test_a_hole_at_the_border_is_ambiguous() -> None:
    """It has one neighbour, and therefore no step at the left border."""
    row = np.full((1, 30), 10, np.float32)
    row[0, :2] = row[0, -2:] = np.nan
    disagree, ambiguous = opencv._causes(row)
    assert not disagree.any()
    np.testing.assert_array_equal(ambiguous, np.isnan(row))


def test_opencv_disparities_at_the_end_of_the_search_are_missing() -> None:
    fixed = np.array([[4 * 16 - 1, 4 * 16, 4 * 16 + 1]], np.int16)
    np.testing.assert_array_equal(opencv.decode(fixed, 4), np.float32([[NAN, NAN, 4 + 1 / 16]]))


def test_the_block_engine_leaves_flat_areas_to_the_texture_check() -> None:
    """OpenCV's own threshold of texture is off."""
    image = np.full((40, 120), 50, np.uint8)
    image[:, :60] = np.random.default_rng(0).integers(0, 255, (40, 60))
    matcher = Matcher(engine=Block(), checks=Checks(), search_px=32)
    assert isinstance(matcher.engine, Block)
    disparity, _ = opencv.compute(image, image, matcher, matcher.engine)
    assert np.isfinite(disparity[:, 80:]).mean() > 0.4


def test_opencv_searches_all_disparities_from_the_first_column_on() -> None:
    """Also with a smallest disparity: columns right of the disparity have depth."""
    left, right = shifted_pair(20)
    for engine in (SemiGlobalBlock(), Block()):
        matcher = Matcher(engine=engine, checks=FAST.checks, search_px=32, min_disparity_px=16)
        disparity, _ = opencv.compute(left, right, matcher, engine)
        assert disparity.shape == left.shape
        assert (np.abs(disparity[8:-8, 30:44] - 20) < 0.5).mean() > 0.9


@pytest.mark.parametrize("side", range(2))
def test_the_least_image_is_16_px_wide_and_high(side: int) -> None:
    shape = [40, 40]
    shape[side] = LEAST_PX
    image = np.zeros(shape, np.uint8)
    assert LEAST_PX == 16 and not match(image, image, replace(D4XX, search_px=16)).valid.any()
    shape[side] -= 1
    with pytest.raises(InputError, match="at least 16 x 16"):
        match(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8), D4XX)


@pytest.mark.parametrize("brighter", ["left", "right"])
def test_ten_bits_end_at_1023(brighter: str) -> None:
    images = {name: np.zeros((20, 20), np.uint16) for name in ("left", "right")}
    images[brighter][3, 3] = TEN_BITS
    match(images["left"], images["right"], replace(D4XX, search_px=16))
    images[brighter][3, 3] += 1
    with pytest.raises(InputError, match="must be <= 1023 as uint16; got 1024"):
        match(images["left"], images["right"], D4XX)


@pytest.mark.parametrize(("bits", "code"), [(9, 700), (10, 700), (11, 350), (12, 175)])
def test_bits_beyond_ten_are_dropped(bits: int, code: int) -> None:
    image = np.full((2, 2), 700, np.uint16)
    assert (readable(image, bits) == code).all()
    small = np.full((2, 2), 200, np.uint8)
    assert (readable(small, 12) == 200).all()


def winners(**changes: Any) -> Winners:
    """One pixel with a distinct winner in both views."""
    image = np.zeros((1, 1))
    fields = {
        "best": image.astype(np.int16),
        "offset": image.astype(np.float32),
        "bend": image.astype(np.float32),
        "right_best": image.astype(np.int16),
        "right_offset": image.astype(np.float32),
        "margin_pct": np.full((1, 1), 50, np.float32),
        "second": np.full((1, 1), 9000, np.uint16),
        "neighbour": np.full((1, 1), 9000, np.uint16),
    }
    return Winners(**(fields | {name: np.array([[value]]) for name, value in changes.items()}))


@pytest.mark.parametrize("census_px", [3, 9, 11])
def test_a_census_compares_half_of_its_window_with_the_centre(census_px: int) -> None:
    """A chequerboard without the centre, symmetric about it; the bits fit one word."""
    pairs = {tuple(map(int, pair)) for pair in census.offsets(census_px)}
    assert len(pairs) == len(census.offsets(census_px)) == (census_px**2 - 1) // 2 <= 64
    assert (0, 0) not in pairs
    assert pairs == {(-y, -x) for y, x in pairs}
    assert max(abs(y) for y, _ in pairs) == max(abs(x) for _, x in pairs) == census_px // 2


def test_a_bit_tells_a_darker_neighbour_beyond_the_tolerance() -> None:
    """Bit k belongs to offset k; a difference of the tolerance is none."""
    offsets = census.offsets(3)
    for number, (y, x) in enumerate(offsets):
        for level, bit in ((69, 1), (70, 0)):
            image = np.full((7, 17), 100, np.uint16)
            image[3 + y, 3 + x] = level
            bits = census.census(image, census_px=3, tolerance=30).bits
            assert bits[3, :, 3].tolist() == [bit << number, 0, 0, 0, 0]


ENGINE = CensusSemiGlobal(second_peak=2.0, neighbour_peak=3.0)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("margin_pct", 10.0),
        ("second", 2 * support.COST_SCALE),
        ("neighbour", 3 * support.COST_SCALE),
    ],
)
def test_a_winner_at_a_threshold_is_distinct(name: str, least: float) -> None:
    """Any single value below its threshold makes the winner ambiguous."""
    assert not matching._indistinct(winners(**{name: least}), 10.0, ENGINE).any()
    assert matching._indistinct(winners(**{name: least - 1}), 10.0, ENGINE).all()


def test_left_right_compares_whole_winners_or_smoothed_ones() -> None:
    """Without a mean the sub-pixel parts do not count."""
    setting = replace(D4XX, checks=replace(D4XX.checks, left_right_px=0.5, left_right_mean_px=0))
    shape = (1, 30)

    def pair(right_best: int, right_offset: float, best: int = 4) -> Winners:
        plain = winners()._asdict()
        fields = {name: np.broadcast_to(values, shape) for name, values in plain.items()}
        fields |= {
            "best": np.full(shape, best, np.int16),
            "right_best": np.full(shape, right_best, np.int16),
            "right_offset": np.full(shape, right_offset, np.float32),
        }
        return Winners(**fields)

    inside = np.s_[:, 8:-8]
    assert not matching._left_right(pair(4, 0.6), setting)[inside].any()
    assert matching._left_right(pair(5, -0.6), setting)[inside].all()
    assert matching._left_right(pair(-1, 0.0), setting)[inside].all()
    mean = replace(setting, checks=replace(setting.checks, left_right_mean_px=3))
    assert matching._left_right(pair(4, 0.6), mean)[inside].all()
    assert not matching._left_right(pair(5, -0.6), mean)[inside].any()
    assert matching._left_right(pair(-1, 0.0), mean)[inside].all()
    for best in (0, 1, 2):  # The marker of a missing match agrees with no disparity.
        assert matching._left_right(pair(-1, 0.0, best), setting)[inside].all()
    assert not matching._left_right(pair(0, 0.0, 0), setting)[inside].any()
    shifted = replace(setting, min_disparity_px=3)
    assert not matching._left_right(pair(4, 0.0), shifted)[inside].any()
    np.testing.assert_array_equal(
        matching._left_right(pair(-1, 0.0), shifted), np.broadcast_to(np.arange(30) >= 7, shape)
    )


@pytest.mark.parametrize("least_px", [0, 5])
def test_whole_winners_left_of_the_image_are_outside(least_px: int) -> None:
    """A winner equal to its column points at column 0 of the right image, inside."""
    left, right = shifted_pair(12)
    result = match(left, right, replace(D4XX, search_px=32, min_disparity_px=least_px))
    assert (result.reason[8:-8, :11] == Reason.OUTSIDE_OVERLAP).mean() > 0.9
    assert (result.reason[8:-8, 14:20] != Reason.OUTSIDE_OVERLAP).mean() > 0.9


def test_texture_counts_only_if_requested() -> None:
    left = np.full((20, 40), 9, np.uint8)
    disparity = np.full(left.shape, 4, np.float32)
    off, on = (replace(FAST.checks, texture_dn=value, jump_px=3.0) for value in (0.0, 0.1))
    assert not matching._support(left, disparity, off, None).any()
    assert matching._support(left, disparity, on, None).all()
    disparity[:, 20:] = 9
    assert np.flatnonzero(matching._support(left, disparity, off, None)[5]).tolist() == [19, 20]


@pytest.mark.parametrize(("weight", "cap_dn"), [(1.0, 9.0), (0.5, 100.0), (0.0, 9.0)])
def test_cost_of_brightness_matches_the_slow_reference(weight: float, cap_dn: float) -> None:
    """Differences of brightness count with their weight, up to the cap."""
    left, right = shifted_pair(9, shape=(16, 40))
    right = np.clip(right.astype(int) + 12, 0, 255).astype(np.uint8)
    engine = CensusSemiGlobal(
        support_px=5, difference_weight=weight, difference_cap_dn=cap_dn, tolerance_dn=0.5
    )
    setting = Matcher(engine=engine, search_px=16)
    fast = np.empty((16, 40, 16), np.uint16)
    matching.support_cost(left, right, setting, engine)(0, fast)
    np.testing.assert_array_equal(fast, slow_cost(left, right, engine, 0, 16))
