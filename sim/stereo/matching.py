"""The stereo matcher: from a rectified infrared pair to disparities with reasons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.imaging.imager import DarkWindow, dark_window
from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.imager import Imager
from starling.sim.sensor.matcher import (
    LEFT_RIGHT_STEP_PX,
    Block,
    CensusSemiGlobal,
    Checks,
    Matcher,
    Refinement,
    SemiGlobalBlock,
)
from starling.sim.stereo import census, checks, opencv, semiglobal, subpixel, support
from starling.sim.stereo.disparity import DisparityMap as DisparityMap
from starling.sim.stereo.memory import Memory

LEAST_PX = 16  # Least side of an image [px]; smaller ones have no room for window and search.
TEN_BITS = 1023  # Largest DN of a 10-bit image.
LEAST_WEIGHT = 2 * support.COST_SCALE  # Of a pixel in the mean: a curvature of 2 bit.
CONSISTENT_PX = 1.0  # Largest left-right difference of winners that support others [px].

_Causes = dict[Reason, NDArray[np.bool_]]


class _Candidates(NamedTuple):
    """Refined disparities of an engine, each (h, w)."""

    disparity_px: NDArray[np.float32]
    causes: _Causes  # Masks of what the engine and its own checks reject.
    consistent: NDArray[np.bool_]  # Both views agree on the winner, before any mean.


def match(
    left: NDArray,
    right: NDArray,
    matcher: Matcher,
    *,
    dark: DarkWindow | None = None,
    memory: Memory | None = None,
) -> DisparityMap:
    """Match a rectified pair, with `matcher.extended` at half the resolution too.

    Args:
        left, right: (h, w) uint8, or uint16 with up to 10 bits; corresponding points share a row.
        matcher: the setting, e.g. `starling.sim.sensor.matcher.named("d4xx")`.
        dark: what a window of the left image shows without light, for `checks.dark_noise`.
        memory: cache of searches with the CensusSemiGlobal engine.

    Returns:
        Disparities of the left image [px]. The reason of a missing one is the first that applies:
        OUTSIDE_OVERLAP; AMBIGUOUS (second best too close, or best at an end of the search);
        LEFT_RIGHT; SUPPORT (texture, darkness, depth edge, few like neighbours); SPECKLE.

    Raises:
        InputError: if the images differ in shape or type, have another type, or are smaller than
            16 x 16.
    """
    if matcher.extended:
        return _extended(left, right, replace(matcher, extended=False), dark, memory)
    _admit(left, right)
    if isinstance(matcher.engine, CensusSemiGlobal):
        candidates = _census_semi_global(left, right, matcher, matcher.engine, memory)
    else:
        candidates = _opencv(left, right, matcher, matcher.engine)
    disparity, causes, consistent = candidates
    alone = checks.unsupported(
        disparity,
        consistent,
        share=matcher.checks.support_share,
        step_px=matcher.checks.support_step_px,
    )
    causes[Reason.SUPPORT] = alone | _support(left, disparity, matcher.checks, dark)
    disparity = np.where(_any(causes), np.float32(np.nan), disparity)
    reach = matcher.min_disparity_px + matcher.search_px
    border = matcher.checks.border_px
    outside = checks.outside_overlap(disparity, reach_px=reach, border_px=border)
    causes[Reason.OUTSIDE_OVERLAP] = outside | causes.get(Reason.OUTSIDE_OVERLAP, np.False_)
    disparity[outside] = np.nan
    disparity = subpixel.apply_pixel_locking(disparity, matcher.refinement.locking_px)
    disparity = subpixel.quantise(disparity, matcher.refinement.quantum_px)
    causes[Reason.SPECKLE] = checks.speckle(
        disparity,
        count=matcher.checks.speckle_count,
        step_px=matcher.checks.speckle_step_px,
    )
    disparity[causes[Reason.SPECKLE]] = np.nan
    valid = np.isfinite(disparity)
    return DisparityMap(disparity_px=disparity, valid=valid, reason=first_cause(valid, causes))


def _extended(
    left: NDArray,
    right: NDArray,
    matcher: Matcher,
    dark: DarkWindow | None,
    memory: Memory | None,
) -> DisparityMap:
    """Match at full and at half resolution, and combine both.

    A pixel without disparity takes that of the half resolution if it lies beyond the full search.
    Devices combine both levels by a rule that is not published; this one is assumed.

    Source: docs of depthai's StereoDepth, extended disparity: 0 to 190 in place of 0 to 95.
    """
    full = match(left, right, matcher, dark=dark, memory=memory)
    lowest = replace(matcher, min_disparity_px=matcher.min_disparity_px // 2)
    # Averaged pixels have less noise than `dark` states, so the check of darkness is stricter.
    half = match(_halved(left), _halved(right), lowest, dark=dark)
    near = np.full_like(full.disparity_px, np.nan)
    doubled = 2 * half.disparity_px.repeat(2, axis=0).repeat(2, axis=1)
    near[: doubled.shape[0], : doubled.shape[1]] = doubled
    end_px = matcher.min_disparity_px + matcher.search_px - 1
    with np.errstate(invalid="ignore"):
        taken = ~full.valid & (near > end_px)
    return DisparityMap(
        disparity_px=np.where(taken, near, full.disparity_px),
        valid=full.valid | taken,
        reason=np.where(taken, np.uint32(0), full.reason),
    )


def _halved(image: NDArray) -> NDArray:
    """Average 2x2 pixels; an odd last row or column is cut off."""
    height, width = (side // 2 for side in image.shape)
    pixels = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))


def readable(image: NDArray, bit_depth: int) -> NDArray:
    """Drop the lowest bits if an image has more than the ten bits that `match` accepts."""
    excess = bit_depth - TEN_BITS.bit_length()
    return image if image.dtype == np.uint8 or excess <= 0 else image >> excess


def darkness(image: NDArray, part: Imager) -> DarkWindow:
    """Return what a window of a readable image shows without light."""
    bits = 8 if image.dtype == np.uint8 else min(part.matched_bits, TEN_BITS.bit_length())
    return dark_window(part, bits)


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


def _support(
    left: NDArray, disparity: NDArray[np.float32], setting: Checks, dark: DarkWindow | None
) -> NDArray[np.bool_]:
    """Reject pixels with too little texture, without light, or at depth edges."""
    refused = checks.jump(disparity, range_px=setting.jump_px)
    dark_dn = setting.dark_noise * dark.deviation_dn if dark else 0.0
    if max(setting.texture_dn, dark_dn) > 0:
        mean, variance = checks.moments(left)
        if setting.texture_dn > 0:  # Rounding makes variances of flat windows negative.
            refused |= checks.texture(variance, least_dn=setting.texture_dn)
        if dark and dark_dn > 0:
            ceiling_dn = dark.ceiling_dn
            refused |= checks.darkness(mean, variance, least_dn=dark_dn, ceiling_dn=ceiling_dn)
    return refused


def support_cost(
    left: NDArray, right: NDArray, matcher: Matcher, engine: CensusSemiGlobal
) -> Callable[[int, NDArray[np.uint16]], None]:
    """Return a function that fills the support cost (rows, w, search) from an image row on.

    The cost of the CensusSemiGlobal engine has `support.COST_SCALE` levels per bit.
    """
    shift, search = matcher.min_disparity_px, matcher.search_px
    level, level_r = (
        census.levels(image, presmooth_px=engine.presmooth_px) for image in (left, right)
    )
    window = {
        "census_px": engine.census_px,
        "tolerance": round(engine.tolerance_dn * census.SUBLEVELS),
    }
    reach = engine.support_px // 2
    return support.SupportCost(
        left=census.census(level, **window),
        right=census.mirrored_census(level_r, **window, pad=shift + support.padding(search)),
        arm=support.arms(level, step=round(engine.arm_step_dn * census.SUBLEVELS), reach=reach),
        reach=reach,
        least_px=shift,
        search_px=search,
        weight=round(16 * engine.difference_weight),
        cap_dn=round(engine.difference_cap_dn),
    ).fill


def _opencv(
    left: NDArray, right: NDArray, matcher: Matcher, engine: SemiGlobalBlock | Block
) -> _Candidates:
    """Run an engine of OpenCV, which checks both views itself, and refine."""
    disparity, causes = opencv.compute(left, right, matcher, engine)
    return _Candidates(subpixel.refine(disparity, matcher.refinement), causes, ~_any(causes))


def _census_semi_global(
    left: NDArray,
    right: NDArray,
    matcher: Matcher,
    engine: CensusSemiGlobal,
    memory: Memory | None,
) -> _Candidates:
    """Run the CensusSemiGlobal engine: search, sub-pixel fit, refinement, its own checks."""

    def search() -> semiglobal.Winners:
        return semiglobal.select(
            support_cost(left, right, matcher, engine),
            (*left.shape, matcher.search_px),
            p1=round(engine.small_penalty * support.COST_SCALE),
            p2=round(engine.large_penalty * support.COST_SCALE),
            shift=matcher.min_disparity_px,
            fit=engine.subpixel_fit,
        )

    winners = search() if memory is None else memory.winners(left, right, matcher, engine, search)
    whole = winners.best + np.int16(matcher.min_disparity_px)
    at_end = winners.best == 0
    if not matcher.checks.near_end:
        at_end |= winners.best == matcher.search_px - 1
    outside = whole > np.arange(left.shape[1])
    causes = {
        Reason.OUTSIDE_OVERLAP: outside,
        Reason.AMBIGUOUS: at_end | _indistinct(winners, matcher.checks.uniqueness, engine),
        Reason.LEFT_RIGHT: _left_right(winners, matcher),
    }
    # Rejected winners would pull the mean of their neighbours. Accepted ones on ramps between
    # two surfaces have no curvature, and without a weight no ramp would be left.
    weight = np.where(
        _any(causes), np.float32(0), np.maximum(winners.bend, np.float32(LEAST_WEIGHT))
    )
    disparity = subpixel.refine(whole + winners.offset, matcher.refinement, weight)
    return _Candidates(disparity, causes, ~outside & _consistent(winners, matcher))


def _indistinct(
    winners: semiglobal.Winners, uniqueness: float, engine: CensusSemiGlobal
) -> NDArray[np.bool_]:
    """Reject winners too close to the second best (in percent or bits) or to a neighbour."""
    scale = support.COST_SCALE
    return (
        (winners.margin_pct < uniqueness)
        | (winners.second < round(engine.second_peak * scale))
        | (winners.neighbour < round(engine.neighbour_peak * scale))
    )


def _consistent(winners: semiglobal.Winners, matcher: Matcher) -> NDArray[np.bool_]:
    """Return where the winners of both views agree, before any mean."""
    if not matcher.checks.support_share:
        return np.ones(winners.best.shape, np.bool_)
    left, right = winners.best + winners.offset, winners.right_best + winners.right_offset
    return ~_disagree(left, right, winners, matcher, CONSISTENT_PX)


def left_right_mean(matcher: Matcher) -> Refinement:
    """Return the refinement of both views before the left-right check."""
    side = matcher.checks.left_right_mean_px
    return replace(
        matcher.refinement,
        smooth_px=side,
        smooth_rows_px=matcher.checks.left_right_rows_px,
        smooth_step_px=LEFT_RIGHT_STEP_PX,
    )


def _left_right(winners: semiglobal.Winners, matcher: Matcher) -> NDArray[np.bool_]:
    """Compare both views: integer winners, or smoothed winners with a sub-pixel part."""
    setting, known = matcher.checks, winners.right_best >= 0
    left, right = winners.best.astype(np.float32), winners.right_best.astype(np.float32)
    if setting.left_right_mean_px:
        smooth = left_right_mean(matcher)
        left = subpixel.refine(left + winners.offset, smooth)
        right = np.where(known, right + winners.right_offset, np.float32(np.nan))
        right = subpixel.refine(right, smooth)
    return _disagree(left, right, winners, matcher, setting.left_right_px)


def _disagree(
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    winners: semiglobal.Winners,
    matcher: Matcher,
    tolerance_px: float,
) -> NDArray[np.bool_]:
    """Compare places of both views in the search [px]; missing matches of the right disagree."""
    shift = np.float32(matcher.min_disparity_px)
    right = np.where(winners.right_best >= 0, right + shift, np.float32(-1))
    return checks.left_right(left + shift, right, tolerance_px=tolerance_px)
