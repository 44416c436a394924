"""The matcher: properties, CensusSemiGlobal against a slow reference, checks, error messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from starling.patterns.errors import InputError
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
from starling.sim.stereo import census, checks, opencv, semiglobal, subpixel, support
from starling.sim.stereo.matching import match
from starling.sim.stereo.matching import support_cost as cost_volume

ENGINES = {
    "fast": FAST,
    "hh": Matcher(engine=SemiGlobalBlock(mode="hh"), checks=FAST.checks),
    "block": Matcher(engine=Block(), checks=FAST.checks),
    "d4xx": D4XX,
}


def dots(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Random dots of about 3 px on a dim background, 8 bits."""
    rng = np.random.default_rng(seed)
    field = np.zeros((shape[0] + 4, shape[1] + 4))
    lit = rng.random(shape) < 0.06
    for dy in range(5):
        for dx in range(5):
            weight = np.exp(-((dy - 2) ** 2 + (dx - 2) ** 2) / 3)
            field[dy : dy + shape[0], dx : dx + shape[1]] += lit * weight
    noise = rng.normal(0, 0.5, shape)
    return np.clip(20 + 60 * field[2:-2, 2:-2] + noise, 0, 255).astype(np.uint8)


def shifted_pair(shift: int, shape=(48, 220), seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A fronto-parallel pair with one disparity: x_left = x_right + shift."""
    wide = dots((shape[0], shape[1] + shift), seed)
    return wide[:, : shape[1]].copy(), wide[:, shift:].copy()


@pytest.mark.parametrize("name", ENGINES)
@given(shift=st.integers(4, 60), seed=st.integers(0, 3))
@settings(max_examples=6)
def test_a_shift_of_k_is_a_disparity_of_k(name, shift, seed):
    left, right = shifted_pair(shift, seed=seed)
    result = match(left, right, replace(ENGINES[name], search_px=64))
    inside = result.disparity_px[8:-8, 90:-12]
    assert np.isfinite(inside).mean() > 0.97
    assert np.abs(np.nanmedian(inside) - shift) < 0.04
    assert np.nanmax(np.abs(inside - shift)) < 0.5


def test_ten_bits_give_what_eight_bits_give():
    left, right = shifted_pair(17)
    eight = match(left, right, D4XX)
    ten = match(left.astype(np.uint16) * 4, right.astype(np.uint16) * 4, D4XX)
    np.testing.assert_array_equal(eight.disparity_px, ten.disparity_px)
    fast = match(left.astype(np.uint16) * 4, right.astype(np.uint16) * 4, FAST)
    np.testing.assert_array_equal(fast.reason, match(left, right, FAST).reason)


def test_the_smallest_disparity_only_moves_the_search():
    left, right = shifted_pair(40)
    near = match(left, right, replace(D4XX, search_px=64))
    moved = match(left, right, replace(D4XX, search_px=64, min_disparity_px=16))
    inside = np.s_[8:-8, 100:-12]
    np.testing.assert_allclose(near.disparity_px[inside], moved.disparity_px[inside], atol=0.04)


@pytest.mark.parametrize("name", ENGINES)
def test_missing_is_nan_with_a_reason_and_the_left_band_is_outside(name):
    left, right = shifted_pair(40)
    result = match(left, right, ENGINES[name])
    np.testing.assert_array_equal(np.isfinite(result.disparity_px), result.valid)
    np.testing.assert_array_equal(result.reason == Reason.VALID, result.valid)
    assert result.disparity_px.dtype == np.float32
    assert result.reason.dtype == np.uint32
    # Left of the disparity nothing was imaged twice: that, and not a search band, is empty.
    # (OpenCV's engines find a few false matches there.)
    band = result.reason[8:-8, :36]
    assert (band[band != Reason.VALID] == Reason.OUTSIDE_OVERLAP).mean() > 0.9
    assert (band == Reason.VALID).mean() < (0.01 if name == "d4xx" else 0.6)
    assert result.valid[8:-8, 56:-12].mean() > 0.97


@given(border=st.floats(0.0, 40.0))
def test_matches_in_the_border_are_outside_and_all_others_stay(border):
    disparity = np.tile(np.linspace(8, 12, 80, dtype=np.float32), (3, 1))
    outside = checks.outside_overlap(disparity, reach_px=16, border_px=border)
    np.testing.assert_array_equal(outside, np.arange(80) - disparity < border)


@pytest.mark.parametrize("name", ENGINES)
def test_a_border_of_the_right_image_widens_the_left_band_by_as_much(name):
    left, right = shifted_pair(40)
    bare = match(left, right, ENGINES[name])
    checked = replace(ENGINES[name].checks, border_px=7)
    result = match(left, right, replace(ENGINES[name], checks=checked))
    assert not result.valid[:, :47].any() and result.valid[8:-8, 56:-12].mean() > 0.97
    assert (result.reason[8:-8, 36:47] == Reason.OUTSIDE_OVERLAP).mean() > 0.9
    remaining = result.valid
    np.testing.assert_array_equal(result.disparity_px[remaining], bare.disparity_px[remaining])


def test_every_matcher_reason_occurs():
    left, right = shifted_pair(30, shape=(96, 260))
    right[30:60, 120:170] = dots((30, 50), seed=9)  # Another scene there: nothing matches.
    left[70:, 180:], right[70:, 150:] = 20, 20  # No texture.
    setting = replace(
        D4XX, search_px=64, checks=replace(D4XX.checks, uniqueness=3.0, speckle_count=400)
    )
    reasons = set(np.unique(match(left, right, setting).reason))
    expected = {"OUTSIDE_OVERLAP", "AMBIGUOUS", "LEFT_RIGHT", "SUPPORT"}
    assert {Reason[name] for name in expected} <= reasons


def test_the_search_ends_are_no_match():
    left, right = shifted_pair(31)
    result = match(left, right, replace(D4XX, search_px=32))
    assert (result.reason[8:-8, 60:-12] == Reason.AMBIGUOUS).mean() > 0.97


@given(gain=st.floats(1.0, 4.0), offset=st.integers(0, 200), seed=st.integers(0, 9))
def test_census_ignores_rising_changes_of_brightness(gain, offset, seed):
    level = np.random.default_rng(seed).integers(0, 4000, (12, 20)).astype(np.uint16)
    changed = np.floor(level * gain + offset).astype(np.uint16)
    before = census.census(level, census_px=9, tolerance=0).bits
    np.testing.assert_array_equal(before, census.census(changed, census_px=9, tolerance=0).bits)


def test_census_tolerance_suppresses_smaller_noise():
    level = np.random.default_rng(0).integers(500, 520, (20, 30)).astype(np.uint16)
    assert not census.census(level, census_px=9, tolerance=20).bits.any()


@given(seed=st.integers(0, 50), apart=st.integers(0, 3))
def test_left_right_check_is_symmetric_under_swap_and_mirror(seed, apart):
    """A pair of pixels that point at each other passes in both views or in neither."""
    rng = np.random.default_rng(seed)
    left, right = rng.integers(0, 8, (2, 6, 40)).astype(np.int16)
    refused = checks.left_right(left, right, tolerance_px=apart)
    # Mirrored and swapped, the right view is the left one; disparities keep their sign.
    second = checks.left_right(right[:, ::-1], left[:, ::-1], tolerance_px=apart)[:, ::-1]
    y, x = np.nonzero(np.arange(40) - left >= 0)
    target = x - left[y, x]
    mutual = right[y, target] == left[y, x]
    assert not refused[y[mutual], x[mutual]].any()
    assert not second[y[mutual], target[mutual]].any()
    far = np.abs(right[y, target].astype(int) - left[y, x]) > apart
    np.testing.assert_array_equal(refused[y, x], far)


def _twin(cost: np.ndarray, p1: int, p2: int) -> np.ndarray:
    """The five paths, by the recurrence of the paper."""
    h, w, search = cost.shape
    total = np.zeros(cost.shape, np.int64)
    for dy, dx in ((0, 1), (0, -1), (1, 1), (1, 0), (1, -1)):
        path = np.zeros(cost.shape, np.int64)
        rows = range(h)
        columns = range(w) if dx >= 0 else range(w - 1, -1, -1)
        for y in rows:
            for x in columns:
                inside = 0 <= y - dy < h and 0 <= x - dx < w
                before = path[y - dy, x - dx] if inside else np.zeros(search, np.int64)
                padded = np.pad(before, 1, constant_values=10**6)
                step = np.minimum(padded[:-2], padded[2:]) + p1
                best = np.minimum(np.minimum(before, step), before.min() + p2)
                path[y, x] = cost[y, x] + best - before.min()
        total += path
    return total


def _vertex(below: int, position: int, above: int) -> float:
    """Vertex of the parabola through three costs, from the middle."""
    bend = below + above - 2 * position
    return float(np.clip((below - above) / (2 * bend), -1, 1)) if bend > 0 else 0.0


def _slopes(below: int, position: int, above: int) -> float:
    """Vertex of the V of equal slopes through three costs, from the middle."""
    bend, rise = below + above - 2 * position, max(below, above) - position
    return float(np.clip((below - above) / (2 * rise), -1, 1)) if bend > 0 else 0.0


@given(seed=st.integers(0, 20), shift=st.integers(0, 3))
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_selection_matches_the_slow_reference(monkeypatch, seed, shift):
    rng = np.random.default_rng(seed)
    h, w, search = 7, 23, 16
    cost = rng.integers(0, 2000, (h, w, search)).astype(np.uint16)
    monkeypatch.setattr(semiglobal, "BAND_ROWS", 3)  # Bands must not show in the result.

    def fill(start: int, out: np.ndarray) -> None:
        out[:] = cost[start : start + len(out)]

    penalties = {"p1": 150, "p2": 900, "shift": shift}
    result = semiglobal.select(fill, cost.shape, **penalties)
    slopes = semiglobal.select(fill, cost.shape, **penalties, fit="equal_slopes")
    of_sums = semiglobal.select(fill, cost.shape, **penalties, fit="equal_slopes_of_sums")
    total = _twin(cost, 150, 900)
    np.testing.assert_array_equal(result.best, total.argmin(2))
    for y in range(h):
        for x in range(w):
            current = [(total[y, x + shift + d, d], d) for d in range(search) if x + shift + d < w]
            right = min(current)[1] if current else -1
            assert result.right_best[y, x] == right
            seen = x + shift + right
            if 0 < right < search - 1 and seen < w - 1:
                three = [int(cost[y, seen + k, right + k]) for k in (-1, 0, 1)]
                for other in (result, of_sums):
                    assert other.right_offset[y, x] == pytest.approx(_vertex(*three), abs=1e-6)
                assert slopes.right_offset[y, x] == pytest.approx(_slopes(*three), abs=1e-6)
            best = int(result.best[y, x])
            others = np.delete(
                total[y, x], [k for k in (best - 1, best, best + 1) if 0 <= k < search]
            )
            margin = 100 * (others.min() / total[y, x, best] - 1)
            assert result.margin_pct[y, x] == pytest.approx(margin, abs=0.01)
            assert result.second[y, x] == others.min() - total[y, x, best]
            sides = total[y, x, [max(best - 1, 0), min(best + 1, search - 1)]]
            assert result.neighbour[y, x] == sides.max() - total[y, x, best]
            if 0 < best < search - 1:
                three = cost[y, x, best - 1 : best + 2].astype(int)
                assert result.offset[y, x] == pytest.approx(_vertex(*three), abs=1e-6)
                assert slopes.offset[y, x] == pytest.approx(_slopes(*three), abs=1e-6)
                three = total[y, x, best - 1 : best + 2].astype(int)
                assert of_sums.offset[y, x] == pytest.approx(_slopes(*three), abs=1e-6)


def _slow_cost(left, right, engine: CensusSemiGlobal, shift: int, search: int) -> np.ndarray:
    """Cost volume with plain numpy: one disparity after the other."""
    level = [census.levels(image, presmooth_px=engine.presmooth_px) for image in (left, right)]
    tolerance = round(engine.tolerance_dn * census.SUBLEVELS)
    half = engine.census_px // 2
    h, w = left.shape
    bits, dn = [], []
    for item in level:
        padded = np.pad(item.astype(int), half, mode="edge")
        taps = [
            padded[half + y : half + y + h, half + x : half + x + w] + tolerance < item
            for y, x in census.offsets(engine.census_px)
        ]
        bits.append(np.stack(taps, -1))
        dn.append((item // census.SUBLEVELS).astype(int))
    weight, cap = round(16 * engine.difference_weight), round(engine.difference_cap_dn)
    out = np.zeros((h, w, search), int)
    for d in range(search):
        source = np.clip(np.arange(w) - shift - d, 0, None)
        hamming = (bits[0] != bits[1][:, source]).sum(-1)
        difference = np.minimum(np.abs(dn[0] - dn[1][:, source]), cap)
        out[:, :, d] = hamming + (difference * weight >> 4)
    step, reach = engine.arm_step_dn * census.SUBLEVELS, engine.support_px // 2
    along = _slow_mean(out, level[0], 1, step, reach, support.ROW_SCALE)
    return _slow_mean(along, level[0], 0, step, reach, support.COST_SCALE // support.ROW_SCALE)


def _slow_mean(cost, level, axis: int, step: float, reach: int, scale: int) -> np.ndarray:
    """Mean along the arms of one axis, pixel by pixel."""
    cost, line = np.moveaxis(cost, axis, 0), np.moveaxis(level.astype(int), axis, 0)
    out = np.empty_like(cost)
    for i, j in np.ndindex(line.shape):
        unlike = np.abs(line[:, j] - line[i, j]) > step
        ends = np.flatnonzero(unlike)
        first = max([i - reach, 0, *(ends[ends < i] + 1)])
        last = min([i + reach + 1, len(line), *ends[ends > i]])
        out[i, j] = cost[first:last, j].sum(0) * ((scale << 16) // (last - first)) >> 16
    return np.moveaxis(out, 0, axis)


@pytest.mark.parametrize(("shift", "step"), [(0, 6.0), (5, 6.0), (0, 0.0), (0, 255.0)])
def test_cost_matches_the_slow_reference(shift, step):
    left, right = shifted_pair(9, shape=(24, 60))
    engine = CensusSemiGlobal(support_px=7, arm_step_dn=step)
    setting = Matcher(engine=engine, search_px=16, min_disparity_px=shift)
    slow = _slow_cost(left, right, engine, shift, 16)
    fast = np.empty((13, 60, 16), np.uint16)
    for start in (0, 11):
        cost_volume(left, right, setting, engine)(start, fast)
        np.testing.assert_array_equal(fast, slow[start : start + 13])


def test_arms_end_at_a_step_of_brightness_and_at_the_border():
    level = np.full((9, 20), 100, np.uint16)
    level[:, 8:] = 200
    west, east, north, south = support.arms(level, step=99, reach=4)[:, 4]
    assert east[:8].tolist() == [4, 4, 4, 4, 3, 2, 1, 0]
    assert west[:4].tolist() == [0, 1, 2, 3]
    assert west[8:14].tolist() == [0, 1, 2, 3, 4, 4]
    assert (north == 4).all() and (south == 4).all()
    assert (support.arms(level, step=100, reach=4)[1, :, 4:15] == 4).all()


def test_left_right_check_has_subpixel_resolution():
    left = np.full((2, 12), 4.4, np.float32)
    right = np.full((2, 12), 5.0, np.float32)
    assert not checks.left_right(left, right, tolerance_px=0.75).any()
    assert checks.left_right(left, right, tolerance_px=0.5)[:, 4:].all()


def test_opencv_fixed_point_is_sixteenths():
    decoded = opencv.decode(np.array([[-16, 0, 8, 24]], np.int16), 0)
    np.testing.assert_array_equal(decoded, np.float32([[np.nan, np.nan, 0.5, 1.5]]))


def test_a_median_does_not_fill_an_engine_s_hole():
    flat = np.full((20, 20), 7, np.float32)
    flat[5:9, 5:9] = np.nan
    out = subpixel.refine(flat, replace(D4XX.refinement, smooth_px=0))
    np.testing.assert_array_equal(np.isnan(out), np.isnan(flat))


def test_quantum_rounds_and_zero_does_not():
    values = np.float32([[1.01, np.nan]])
    np.testing.assert_array_equal(subpixel.quantise(values, 0.0), values)
    np.testing.assert_array_equal(subpixel.quantise(values, 0.25), np.float32([[1.0, np.nan]]))


def test_checks_reject_the_named_defects():
    step = np.full((12, 12), 5, np.float32)
    step[:, 6:] = 9
    np.testing.assert_array_equal(np.nonzero(checks.jump(step, range_px=3.0)[0])[0], [5, 6])
    assert not checks.jump(step, range_px=4.0).any()
    assert checks.speckle(step, count=80, step_px=1.0).all()
    assert not checks.speckle(step, count=0, step_px=1.0).any()
    _, flat = checks.moments(np.full((20, 20), 9, np.uint8))
    _, dotted = checks.moments(dots((40, 40)))
    assert checks.texture(flat, least_dn=0.1).all()
    assert not checks.texture(dotted, least_dn=0.1).any()


def test_neutral_checks_reject_only_unmatchable_pixels():
    left, right = shifted_pair(20)
    result = match(left, right, replace(D4XX, checks=Checks()))
    assert set(np.unique(result.reason)) <= {
        Reason.VALID, Reason.OUTSIDE_OVERLAP, Reason.AMBIGUOUS, Reason.LEFT_RIGHT
    }  # fmt: skip


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (np.zeros((20, 20), np.uint8), np.zeros((20, 30), np.uint8),
         "left and right must share one shape; got (20, 20) and (20, 30)."),
        (np.zeros((20, 20), np.uint8), np.zeros((20, 20), np.uint16),
         "left and right must both be uint8 or uint16; got uint8 and uint16."),
        (np.zeros((20, 20)), np.zeros((20, 20)), "must both be uint8 or uint16; got float64"),
        (np.zeros((8, 20), np.uint8), np.zeros((8, 20), np.uint8), "at least 16 x 16; got (8, 20)"),
        (np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.uint8), "at least 16 x 16; got (0, 0)"),
        (np.zeros((20, 20, 3), np.uint8), np.zeros((20, 20, 3), np.uint8), "must be (h, w)"),
        (np.full((20, 20), 1024, np.uint16), np.zeros((20, 20), np.uint16),
         "must be <= 1023 as uint16; got 1024. Shift them to 10 bits."),
    ],
)  # fmt: skip
def test_pairs_that_cannot_be_matched_are_refused(left, right, message):
    with pytest.raises(InputError) as refusal:
        match(left, right, D4XX)
    assert message in str(refusal.value)
