"""The stereo matcher of a batch: from infrared pairs to disparities with reasons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from starling.sim.batch import checks, cost, handoff, islands, paths, refinement
from starling.sim.batch.dark_table import PER_OCTAVE, DarkTable
from starling.sim.batch.handoff import launch
from starling.sim.sensor.matcher import CensusSemiGlobal, Matcher, Refinement
from starling.sim.stereo import census, support
from starling.sim.stereo.matching import left_right_mean

wp: Any = handoff.import_warp()

_GROUP = 32  # Threads that a GPU runs in step.
_TEN_BIT_CODES = 4  # Codes of a 10-bit image per DN.


@dataclass(frozen=True, slots=True, eq=False)
class MatchRig:
    """Constants of a matcher on a device."""

    matcher: Matcher
    device: Any
    bits: int  # Of the codes, 8 or 10.
    search: Any  # `cost.Search`
    offsets: Any  # (n,) vec2i of the census.
    presmooth: Any  # (2 reach + 1,)
    brightness: Any  # Differences above which the cost rises [DN].
    row_shares: Any  # (16,)
    column_shares: Any  # (16,)
    penalties: tuple[int, int]
    peaks: Any  # `paths.Peaks`
    limits: Any  # `checks.Limits`
    dark: Any  # Deviations and means of windows without light by gain [codes]; () is off.
    own_gain: float  # Of the first entry.


def match_rig(matcher: Matcher, bits: int, dark: DarkTable, device: Any) -> MatchRig:
    """Copy a matcher with the CensusSemiGlobal engine to a device.

    Args:
        matcher: the matcher.
        bits: bits of the codes; more than 8 count as 10.
        dark: what windows of the left image show without light.
        device: Warp device.
    """
    engine = matcher.engine
    assert isinstance(engine, CensusSemiGlobal)  # `refuse_unsupported` refuses the others.
    codes_per_dn = 1 if bits == 8 else _TEN_BIT_CODES
    search = cost.Search()
    search.least, search.search = matcher.min_disparity_px, matcher.search_px
    search.tolerance = round(engine.tolerance_dn * census.SUBLEVELS)
    search.arm_step = round(engine.arm_step_dn * census.SUBLEVELS)
    search.arm = engine.support_px // 2
    peaks = paths.Peaks()
    peaks.uniqueness = matcher.checks.uniqueness
    peaks.second = round(engine.second_peak * support.COST_SCALE)
    peaks.neighbour = round(engine.neighbour_peak * support.COST_SCALE)
    peaks.near_end = int(matcher.checks.near_end)
    peaks.equal_slopes = int(engine.subpixel_fit != "parabola")
    peaks.of_sums = int(engine.subpixel_fit == "equal_slopes_of_sums")
    brightness = support.difference_limits(
        round(16 * engine.difference_weight), round(engine.difference_cap_dn)
    )

    def shares(scale: int) -> Any:
        values = [0, *((scale << 16) // count for count in range(1, 16))]
        return wp.array(np.array(values, np.uint32), dtype=wp.uint32, device=device)

    return MatchRig(
        matcher=matcher,
        device=device,
        bits=8 if bits == 8 else 10,
        search=search,
        offsets=wp.array(census.offsets(engine.census_px), dtype=wp.vec2i, device=device),
        presmooth=wp.array(_gaussian(engine.presmooth_px), dtype=float, device=device),
        brightness=wp.array(brightness.astype(np.int32), dtype=int, device=device),
        row_shares=shares(support.ROW_SCALE),
        column_shares=shares(support.COST_SCALE // support.ROW_SCALE),
        penalties=(
            round(engine.small_penalty * support.COST_SCALE),
            round(engine.large_penalty * support.COST_SCALE),
        ),
        peaks=peaks,
        limits=_limits(matcher, codes_per_dn),
        dark=wp.array(_darkness(matcher, dark, codes_per_dn), dtype=wp.vec2, device=device),
        own_gain=dark.own_gain,
    )


def match(left: Any, right: Any, gain: Any, rig: MatchRig) -> tuple[Any, Any]:
    """Match rectified pairs.

    Args:
        left, right: (n, h, w) uint16 codes on the rig's device.
        gain: (n,) of the left imager.
        rig: the matcher.

    Returns:
        (n, h, w) disparities [px], NaN without disparity, and codes of reasons, 0 if and only if
        there is disparity.
    """
    winners = _choose(left, right, rig)
    shape, device, setting = left.shape, rig.device, rig.matcher.checks
    if setting.left_right_mean_px:
        smoothed = left_right_mean(rig.matcher)
        views = tuple(_refine(each, smoothed, None) for each in (winners.left, winners.right))
    else:
        views = tuple(_as_float(each) for each in (winners.left_best, winners.right_best))
    texture = wp.empty((0, 0, 0), dtype=wp.vec2i, device=device)
    if setting.texture_dn > 0 or rig.dark.shape[0]:
        texture = wp.empty(shape, dtype=wp.vec2i, device=device)
        launch(checks.sum_texture, shape, device, left, texture)
    dark = _dark(texture, gain, rig)
    compared, reason = (wp.empty(shape, dtype=wp.uint8, device=device) for _ in range(2))
    matches = (winners.left_best, winners.ambiguous, *views, rig.limits, winners.bend)
    launch(checks.compare_views, shape, device, *matches, compared)
    refined = _refine(winners.left, rig.matcher.refinement, winners.bend)
    disparity = wp.empty_like(refined)
    support_of = (refined, compared, _consistent(winners, rig), texture, dark, rig.limits)
    launch(checks.reject, shape, device, *support_of, disparity, reason)
    launch(checks.reject_outside, shape[:2], device, rig.limits, disparity, reason)
    _sink_islands(disparity, reason, rig)
    return disparity, reason


def _dark(texture: Any, gain: Any, rig: MatchRig) -> Any:
    """Mark (n, h, w) the pixels in windows without light; () if the check is off."""
    if not rig.dark.shape[0]:
        return wp.empty((0, 0, 0), dtype=wp.uint8, device=rig.device)
    shape, device = texture.shape, rig.device
    dark, count = (wp.empty(shape, dtype=wp.uint8, device=device) for _ in range(2))
    limits = wp.empty(shape[0], dtype=wp.vec2, device=device)
    table = (rig.dark, rig.own_gain, float(PER_OCTAVE))
    launch(checks.limit_darkness, limits.shape, device, gain, *table, limits)
    launch(checks.find_dark, shape, device, texture, limits, dark)
    launch(checks.count_dark, shape, device, dark, count)
    launch(checks.spread_dark, shape, device, count, dark)
    return dark


def _consistent(winners: _Winners, rig: MatchRig) -> Any:
    """Mark (n, h, w) where the winners of both views agree; () if support is not checked."""
    if not rig.matcher.checks.support_share:
        return wp.empty((0, 0, 0), dtype=wp.uint8, device=rig.device)
    consistent = wp.empty(winners.left.shape, dtype=wp.uint8, device=rig.device)
    views = (winners.left_best, winners.left, winners.right)
    launch(checks.find_consistent, consistent.shape, rig.device, *views, consistent)
    return consistent


@dataclass(frozen=True, slots=True, eq=False)
class _Winners:
    """Chosen disparities, each (n, h, w)."""

    left_best: Any  # Whole [px].
    left: Any  # [px]
    bend: Any
    ambiguous: Any
    right_best: Any
    right: Any


def _choose(left: Any, right: Any, rig: MatchRig) -> _Winners:
    shape, device = left.shape, rig.device
    search = rig.matcher.search_px
    (n, h, w), least = shape, rig.matcher.min_disparity_px
    support_cost = wp.empty(n * h * w * search, dtype=wp.uint16, device=device)
    total = wp.empty_like(support_cost)
    _fill_cost(left, right, rig, support_cost, total)
    total.zero_()
    for dx, dy in paths.DIRECTIONS:
        wp.launch_tiled(
            paths.sweep(search),
            dim=(n, w if dy else h),
            inputs=[support_cost, total, h, w, dx, dy, *rig.penalties],
            block_dim=-(-search // _GROUP) * _GROUP,
            device=device,
        )
    best, disparity, bend, ambiguous, best_r, disparity_r = (
        wp.empty(shape, dtype=dtype, device=device)
        for dtype in (wp.int16, float, float, wp.uint8, wp.int16, float)
    )
    volumes = (support_cost, total, search, least)
    chosen = (best, disparity, bend, ambiguous)
    launch(paths.choose_left, shape, device, *volumes, rig.peaks, *chosen)
    slopes = int(rig.peaks.equal_slopes and not rig.peaks.of_sums)
    launch(paths.choose_right, shape, device, *volumes, slopes, best_r, disparity_r)
    return _Winners(best, disparity, bend, ambiguous, best_r, disparity_r)


def _fill_cost(left: Any, right: Any, rig: MatchRig, support_cost: Any, scratch: Any) -> None:
    """Fill the flat cost volume; `scratch` is a volume of the same size."""
    (n, h, w), device = left.shape, rig.device
    search = rig.matcher.search_px
    levels, words = [], []
    for codes in (left, right):
        smoothed = wp.empty(codes.shape, dtype=float, device=device)
        level = wp.empty(codes.shape, dtype=wp.uint16, device=device)
        bits = wp.empty(codes.shape, dtype=wp.uint64, device=device)
        scale = float(census.SUBLEVELS if rig.bits == 8 else census.SUBLEVELS / _TEN_BIT_CODES)
        launch(cost.smooth_rows, codes.shape, device, codes, rig.presmooth, scale, smoothed)
        launch(cost.smooth_columns, codes.shape, device, smoothed, rig.presmooth, level)
        launch(cost.compare, codes.shape, device, level, rig.offsets, rig.search, bits)
        levels.append(level)
        words.append(bits)
    arms = wp.empty(left.shape, dtype=wp.vec4ub, device=device)
    views = (words[0], levels[0], words[1], levels[1], rig.brightness, rig.search)
    launch(cost.grow_arms, left.shape, device, levels[0], rig.search, arms)
    launch(cost.sum_cost_along_rows, (n, h, search), device, *views, support_cost)
    means = (arms, rig.row_shares, rig.search)
    launch(cost.sum_means_along_columns, (n, w, search), device, support_cost, *means, scratch)
    means = (arms, rig.column_shares, rig.search)
    launch(cost.average_columns, (n, h, w, search), device, scratch, *means, support_cost)


def _median(disparity: Any, setting: Refinement) -> Any:
    if not setting.median_px:
        return disparity
    filtered = wp.empty_like(disparity)
    kernel = refinement.median(setting.median_px)
    launch(kernel, disparity.shape, disparity.device, disparity, filtered)
    return filtered


def _refine(disparity: Any, setting: Refinement, weight: Any | None) -> Any:
    filtered = _median(disparity, setting)
    return _mean(filtered, setting, weight) if setting.smooth_px > 1 else filtered


def _mean(disparity: Any, setting: Refinement, weight: Any | None) -> Any:
    """Average over the mean's window; without weights all pixels are equal."""
    device = disparity.device
    if weight is None:
        weight = wp.empty((0, 0, 0), dtype=float, device=device)
    sides = (setting.smooth_px, min(setting.smooth_rows_px, setting.smooth_px))
    for down, side in enumerate(sides):
        averaged, gathered = wp.empty_like(disparity), wp.empty_like(disparity)
        quantum_px = setting.mean_quantum_px if down else 0.0
        window = (side, down, setting.smooth_step_px, quantum_px)
        arguments = (disparity, weight, *window, averaged, gathered)
        launch(refinement.average, disparity.shape, device, *arguments)
        disparity, weight = averaged, gathered
    return disparity


def _as_float(best: Any) -> Any:
    converted = wp.empty(best.shape, dtype=float, device=best.device)
    wp.utils.array_cast(best, converted)
    return converted


def _sink_islands(disparity: Any, reason: Any, rig: MatchRig) -> None:
    """Apply locking and quantum, and remove small islands."""
    shape, device = disparity.shape, rig.device
    island = wp.empty(math.prod(shape), dtype=int, device=device)
    launch(checks.settle, shape, device, rig.limits, disparity, island)
    if not rig.matcher.checks.speckle_count:
        return
    count = wp.zeros_like(island)
    launch(islands.join_islands, shape, device, disparity, rig.limits, island)
    launch(islands.count_islands, island.shape, device, island, count)
    launch(islands.sink_islands, shape, device, island, count, rig.limits, disparity, reason)


def _gaussian(sigma_px: float) -> np.ndarray[Any, Any]:
    """Return the weights that `cv2.GaussianBlur` takes for float32 images."""
    if sigma_px == 0:
        return np.ones(1, np.float32)
    side = round(8 * sigma_px + 1) | 1
    return np.asarray(cv2.getGaussianKernel(side, sigma_px, cv2.CV_32F), np.float32).ravel()


def _darkness(matcher: Matcher, dark: DarkTable, codes_per_dn: int) -> np.ndarray[Any, Any]:
    """Largest deviation and mean of windows without light by gain [codes]; () if all pass."""
    rows = [
        (
            matcher.checks.dark_noise * window.deviation_dn * codes_per_dn,
            window.ceiling_dn * codes_per_dn,
        )
        for window in dark.windows
    ]
    used = any(deviation > 0 for deviation, _ in rows)
    return np.array(rows if used else np.zeros((0, 2)), np.float32)


def _limits(matcher: Matcher, codes_per_dn: int) -> Any:
    limits, setting = checks.Limits(), matcher.checks
    limits.left_right, limits.jump = setting.left_right_px, setting.jump_px
    limits.texture = (setting.texture_dn * codes_per_dn) ** 2
    limits.border = setting.border_px
    limits.support, limits.like = setting.support_share, setting.support_step_px
    limits.reach = matcher.min_disparity_px + matcher.search_px
    limits.locking = matcher.refinement.locking_px
    limits.quantum = matcher.refinement.quantum_px
    limits.speckle, limits.step = setting.speckle_count, 16 * setting.speckle_step_px
    return limits
