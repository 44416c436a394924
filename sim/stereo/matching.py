"""The stereo matcher: a rectified infrared pair in, disparities with reasons out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.matcher import CensusSemiGlobal, Checks, Matcher
from starling.sim.stereo import census, checks, opencv, semiglobal, subpixel, support
from starling.sim.stereo.disparity import DisparityMap as DisparityMap
from starling.sim.stereo.memory import Memory

LEAST_PX = 16  # A smaller image holds no window and no search.
TEN_BITS = 1023

_Causes = dict[Reason, NDArray[np.bool_]]


def match(
    left: NDArray, right: NDArray, matcher: Matcher, *, memory: Memory | None = None
) -> DisparityMap:
    """Match a rectified pair.

    Args:
        left, right: (h, w) uint8, or uint16 of up to 10 bits; corresponding points share a row.
        matcher: the setting, e.g. `starling.sim.sensor.matcher.named("d4xx")`.
        memory: of searches of the own engine, in which pairs are not searched twice.

    Returns:
        Disparities of the left image [px]. A missing one is OUTSIDE_OVERLAP, AMBIGUOUS (second
        best too near, or the best at the search's end), LEFT_RIGHT, SUPPORT (texture, depth edge)
        or SPECKLE, whichever comes first.

    Raises:
        InputError: if the images differ in shape or type, are not of the types above, or are
            smaller than 16 x 16.
    """
    _admit(left, right)
    if isinstance(matcher.engine, CensusSemiGlobal):
        disparity, causes = _census_semi_global(left, right, matcher, matcher.engine, memory)
    else:
        disparity, causes = opencv.compute(left, right, matcher, matcher.engine)
        disparity = subpixel.refine(disparity, matcher.refinement)
    causes[Reason.SUPPORT] = _support(left, disparity, matcher.checks)
    disparity = np.where(_any(causes), np.float32(np.nan), disparity)
    reach = matcher.min_disparity_px + matcher.search_px
    border = matcher.checks.border_px
    outside = checks.outside_overlap(disparity, reach_px=reach, border_px=border)
    causes[Reason.OUTSIDE_OVERLAP] = outside | causes.get(Reason.OUTSIDE_OVERLAP, np.False_)
    disparity[outside] = np.nan
    disparity = subpixel.locked(disparity, matcher.refinement.locking_px)
    disparity = subpixel.quantise(disparity, matcher.refinement.quantum_px)
    causes[Reason.SPECKLE] = checks.speckle(
        disparity,
        count=matcher.checks.speckle_count,
        step_px=matcher.checks.speckle_step_px,
    )
    disparity[causes[Reason.SPECKLE]] = np.nan
    valid = np.isfinite(disparity)
    return DisparityMap(disparity_px=disparity, valid=valid, reason=first_cause(valid, causes))


def readable(image: NDArray, bit_depth: int) -> NDArray:
    """Leave out the bits that a converter has beyond the ten that `match` reads."""
    excess = bit_depth - TEN_BITS.bit_length()
    return image if image.dtype == np.uint8 or excess <= 0 else image >> excess


def _admit(left: NDArray, right: NDArray) -> None:
    """Refuse pairs that cannot be matched."""
    if left.shape != right.shape:
        raise refuse(
            "left and right",
            "must share one shape",
            f"{left.shape} and {right.shape}",
            "Rectify both with the same rig.",
        )
    if left.dtype != right.dtype or left.dtype not in (np.uint8, np.uint16):
        raise refuse(
            "left and right",
            "must both be uint8 or uint16",
            f"{left.dtype} and {right.dtype}",
            "Convert both to one of them.",
        )
    if left.ndim != 2 or min(left.shape) < LEAST_PX:
        raise refuse(
            "left and right",
            f"must be (h, w) of at least {LEAST_PX} x {LEAST_PX}",
            left.shape,
            "Give one grey image per imager.",
        )
    if left.dtype == np.uint16 and max(left.max(), right.max()) > TEN_BITS:
        raise refuse(
            "left and right",
            f"must be <= {TEN_BITS} as uint16",
            max(left.max(), right.max()),
            "Shift them to 10 bits.",
        )


def _any(causes: _Causes) -> NDArray[np.bool_]:
    return reduce(np.logical_or, causes.values())


def _support(left: NDArray, disparity: NDArray[np.float32], setting: Checks) -> NDArray[np.bool_]:
    """Too little texture, or neighbours that disagree."""
    refused = checks.jump(disparity, range_px=setting.jump_px)
    if setting.texture_dn > 0:
        refused |= checks.texture(left, least_dn=setting.texture_dn)
    return refused


def support_cost(
    left: NDArray, right: NDArray, matcher: Matcher, engine: CensusSemiGlobal
) -> Callable[[int, NDArray[np.uint16]], None]:
    """Cost of the own engine: a call fills (rows, w, search) from the given image row on.

    The cost has `support.COST_SCALE` levels per bit.
    """
    shift = matcher.min_disparity_px
    tolerance = round(engine.tolerance_dn * census.SUBLEVELS)
    level, level_r = (
        census.levels(image, presmooth_px=engine.presmooth_px) for image in (left, right)
    )
    bits = census.census(level, census_px=engine.census_px, tolerance=tolerance)
    bits_r = census.census(level_r, census_px=engine.census_px, tolerance=tolerance)
    dn, dn_r = ((one // census.SUBLEVELS).astype(np.uint8) for one in (level, level_r))
    beyond = shift + matcher.search_px
    bits_r, dn_r = census.mirrored(bits_r, pad=beyond), census.mirrored(dn_r, pad=beyond)
    weight = np.uint16(round(16 * engine.difference_weight))
    cap, reach = np.uint16(round(engine.difference_cap_dn)), engine.support_px // 2
    arms = support.arms(level, step=round(engine.arm_step_dn * census.SUBLEVELS), reach=reach)

    def fill(start: int, out: NDArray[np.uint16]) -> None:
        support.support_cost(bits, bits_r, dn, dn_r, shift, weight, cap, arms, reach, start, out)

    return fill


def _census_semi_global(
    left: NDArray,
    right: NDArray,
    matcher: Matcher,
    engine: CensusSemiGlobal,
    memory: Memory | None,
) -> tuple[NDArray[np.float32], _Causes]:
    """Run the own engine: cost, selection, sub-pixel fit, refinement, and the checks it can do."""

    def search() -> semiglobal.Winners:
        return semiglobal.select(
            support_cost(left, right, matcher, engine),
            (*left.shape, matcher.search_px),
            p1=round(engine.small_penalty * support.COST_SCALE),
            p2=round(engine.large_penalty * support.COST_SCALE),
            shift=matcher.min_disparity_px,
        )

    found = search() if memory is None else memory.winners(left, right, matcher, engine, search)
    whole = found.best + np.int16(matcher.min_disparity_px)
    at_end = (found.best == 0) | (found.best == matcher.search_px - 1)
    causes = {
        Reason.OUTSIDE_OVERLAP: whole > np.arange(left.shape[1]),
        Reason.AMBIGUOUS: at_end | _indistinct(found, matcher.checks.uniqueness, engine),
        Reason.LEFT_RIGHT: _left_right(found, matcher),
    }
    disparity = subpixel.refine(whole + found.offset, matcher.refinement, found.bend)
    return disparity, causes


def _indistinct(
    found: semiglobal.Winners, uniqueness: float, engine: CensusSemiGlobal
) -> NDArray[np.bool_]:
    """Winners that do not stand out: by percent, or by bits over the second best or beside."""
    scale = support.COST_SCALE
    return (
        (found.margin_pct < uniqueness)
        | (found.second < round(engine.second_peak * scale))
        | (found.neighbour < round(engine.neighbour_peak * scale))
    )


def _left_right(found: semiglobal.Winners, matcher: Matcher) -> NDArray[np.bool_]:
    """Compare both views: their whole winners, or smoothed values with a sub-pixel part."""
    setting, seen = matcher.checks, found.right_best >= 0
    left, right = found.best.astype(np.float32), found.right_best.astype(np.float32)
    if setting.left_right_mean_px:
        side = setting.left_right_mean_px
        smooth = replace(matcher.refinement, smooth_px=side, smooth_rows_px=side)
        left = subpixel.refine(left + found.offset, smooth)
        right = np.where(seen, right + found.right_offset, np.float32(np.nan))
        right = subpixel.refine(right, smooth)
    shift = np.float32(matcher.min_disparity_px)
    right = np.where(seen, right + shift, np.float32(-1))
    return checks.left_right(left + shift, right, apart_px=setting.left_right_px)
