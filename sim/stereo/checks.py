"""Consistency checks of a match. Every check returns the mask of the rejected pixels."""

from __future__ import annotations

import math

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.lanes import (
    WORDS,
    equal,
    excess,
    lesser,
    load_words,
    splat_words,
    store_low_bytes,
)

TEXTURE_PX = 15  # Window of the texture check [px]: about one support plus one census window.
LEAST_DARK = TEXTURE_PX  # Unlit centres in a window that make its middle dark: one row.
SUPPORT_PX = 13  # Window of the support check [px]; a D4 counts up to 168 of its neighbours.
_LANES = WORDS.count
_LEVELS = 64  # Levels per px in the support check.
_FAR = 65535  # Level of a missing pixel; the largest disparity has 49,088.
_NONE = -16  # Marks a missing value; below any disparity in OpenCV's fixed point.


def outside_overlap(
    disparity_px: NDArray, *, reach_px: int, border_px: float = 0.0
) -> NDArray[np.bool_]:
    """Reject pixels whose match lies left of the right image's first column.

    A pixel without disparity takes the disparity of the next valid pixel to its right. In the left
    border a matcher finds no match or a wrong one, and that surface usually continues there.

    Args:
        disparity_px: (h, w) [px], NaN without disparity.
        reach_px: largest searched disparity [px].
        border_px: further columns of the right image to exclude [px].
    """
    out = np.zeros(disparity_px.shape, bool)
    # Further right no pixel can be rejected, neither by its own nor by a neighbour's disparity.
    border = disparity_px[:, : 2 * (reach_px + math.ceil(border_px))]
    width = border.shape[1]
    columns = np.arange(width)
    place = np.where(np.isfinite(border), columns, width - 1)
    following = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    out[:, :width] = np.take_along_axis(border, following, axis=1) > columns - border_px
    return out


def left_right(left: NDArray, right: NDArray, *, tolerance_px: float) -> NDArray[np.bool_]:
    """Reject pixels whose match in the right view has a different disparity.

    Args:
        left, right: (h, w) disparities [px] of each view; right is negative without disparity.
        tolerance_px: largest accepted difference [px].

    Returns:
        (h, w) mask; pixels that point outside the image are covered by `outside_overlap`.
    """
    out = np.zeros(left.shape, np.bool_)
    _left_right(left, right, np.float32(tolerance_px), out)
    return out


@nb.njit(nogil=True, cache=True)
def _left_right(left, right, tolerance, out):  # pragma: no cover - compiled
    h, w = left.shape
    for y in range(h):
        for x in range(w):
            target = x - np.int64(np.rint(left[y, x]))
            if 0 <= target < w:
                matched = right[y, target]
                out[y, x] = matched < 0 or abs(matched - left[y, x]) > tolerance


def moments(image: NDArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and variance of every pixel's window [DN of 8 bits and their square]."""
    level = image.astype(np.float32) if image.dtype == np.uint8 else image / np.float32(4)
    window = (TEXTURE_PX, TEXTURE_PX)
    mean = cv2.blur(level, window)
    square = cv2.sqrBoxFilter(level, cv2.CV_32F, window)
    return np.asarray(mean, np.float32), np.asarray(square - mean * mean, np.float32)


def texture(variance: NDArray[np.float32], *, least_dn: float) -> NDArray[np.bool_]:
    """Reject pixels whose window has a standard deviation below `least_dn` (8-bit DN)."""
    return variance < np.float32(least_dn) ** 2


def darkness(
    mean: NDArray[np.float32],
    variance: NDArray[np.float32],
    *,
    least_dn: float,
    ceiling_dn: float,
) -> NDArray[np.bool_]:
    """Reject pixels in the windows without light.

    Rejection of their centres alone would leave a rim, whose own windows contain the object's
    light. A pixel is rejected if its window holds at least `LEAST_DARK` such centres. Straight
    rims end at the light then. A few dim windows on a lit surface reject nothing.

    Args:
        mean, variance: (h, w) of `moments`.
        least_dn: standard deviation of the darkest lit window [DN of 8 bits].
        ceiling_dn: brighter windows are lit [DN of 8 bits]; full pixels are as flat as dark ones.
    """
    unlit = (variance < np.float32(least_dn) ** 2) & (mean < np.float32(ceiling_dn))
    window = (TEXTURE_PX, TEXTURE_PX)
    count = cv2.boxFilter(
        unlit.view(np.uint8), cv2.CV_8U, window, normalize=False, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(count >= LEAST_DARK)


def jump(disparity_px: NDArray[np.float32], *, range_px: float) -> NDArray[np.bool_]:
    """Reject pixels whose 3x3 neighbourhood spans more than `range_px` of disparity."""
    known = np.isfinite(disparity_px)
    if not known.any() or np.nanmax(disparity_px) - np.nanmin(disparity_px) <= range_px:
        return np.zeros(known.shape, bool)
    kernel = np.ones((3, 3), np.uint8)
    high = cv2.dilate(np.where(known, disparity_px, np.float32(-1e6)), kernel)
    low = cv2.erode(np.where(known, disparity_px, np.float32(1e6)), kernel)
    return known & (high - low > range_px)


def unsupported(
    disparity_px: NDArray[np.float32],
    consistent: NDArray[np.bool_],
    *,
    share: float,
    step_px: float,
) -> NDArray[np.bool_]:
    """Reject pixels that too small a share of the neighbours in their window supports.

    Args:
        disparity_px: (h, w) [px], w >= 16, NaN without disparity.
        consistent: (h, w) pixels that can support others: both views agree on their winners.
        share: least share of the window's other pixels within the image, 0 to 1; 0 accepts all.
        step_px: largest difference to a disparity that supports [px].

    Source: a D4's region support map (librealsense presets.cpp: diffThresh 4, removeThresh 63 of
    168). Which neighbours it counts is not published (docs/design/matcher.md#the-preset-d415).
    """
    h, w = disparity_px.shape
    if not share:
        return np.zeros((h, w), np.bool_)
    reach = SUPPORT_PX // 2
    known = np.isfinite(disparity_px)
    centre = np.full((h, w), _FAR, np.uint16)
    np.copyto(centre, np.rint(disparity_px * _LEVELS), where=known, casting="unsafe")
    # Pixels without support to give and those outside the image are unlike every known one.
    level = np.full((h + 2 * reach, w + 2 * reach), _FAR, np.uint16)
    np.copyto(level[reach : reach + h, reach : reach + w], centre, where=consistent)
    like = np.empty((h, w), np.uint8)
    step = np.uint16(round(step_px * _LEVELS))
    _count_like(centre.reshape(-1), level.reshape(-1), h, w, step, like.reshape(-1))
    rows, columns = (
        np.convolve(np.ones(side, np.float32), np.ones(SUPPORT_PX, np.float32), "same")
        for side in (h, w)
    )
    others = rows[:, None] * columns - 1
    itself = consistent & known
    return ~known | (like - itself.astype(np.float32) < np.float32(share) * others)


@nb.njit(nogil=True, cache=True)
def _count_like(centre, level, h, w, step, like):  # pragma: no cover - compiled
    """Count the pixels of every window whose level is within `step` of the centre's.

    `level` has a margin of half a window around the image.
    """
    reach = SUPPORT_PX // 2
    stride, steps = w + 2 * reach, splat_words(step)
    for y in range(h):
        for start in range(0, w, _LANES):
            x = min(start, w - _LANES)  # The last vector overlaps the one before.
            middle = load_words(centre, y * w + x)
            count = splat_words(np.uint16(0))
            for row in range(y, y + SUPPORT_PX):
                for dx in range(SUPPORT_PX):
                    neighbour = load_words(level, row * stride + x + dx)
                    off = excess(neighbour, middle) | excess(middle, neighbour)
                    count = count - equal(lesser(off, steps), off)  # A set mask is -1.
            store_low_bytes(like, y * w + x, count)


def speckle(disparity_px: NDArray[np.float32], *, count: int, step_px: float) -> NDArray[np.bool_]:
    """Reject islands of at most `count` pixels, bounded by disparity steps above `step_px`."""
    if not count:
        return np.zeros(disparity_px.shape, bool)
    valid = np.isfinite(disparity_px)
    fixed = np.where(valid, disparity_px * 16, _NONE).astype(np.int16)
    cv2.filterSpeckles(fixed, _NONE, count, step_px * 16)
    return valid & (fixed == _NONE)
