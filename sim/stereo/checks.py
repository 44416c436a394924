"""Consistency checks of a match. Every check returns the mask of the rejected pixels."""

from __future__ import annotations

import math

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

TEXTURE_PX = 15  # Window of the texture check [px]: about one support plus one census window.
SUPPORT_PX = 13  # Window of the support check [px]; a D4 counts up to 168 of its neighbours.
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
    """Reject all pixels of every window without light.

    None of its pixels is lit, so all are rejected. Rejection of the centre alone would leave a rim,
    whose windows contain the object's light.

    Args:
        mean, variance: (h, w) of `moments`.
        least_dn: standard deviation of the darkest lit window [DN of 8 bits].
        ceiling_dn: brighter windows are lit [DN of 8 bits]; full pixels are as flat as dark ones.
    """
    unlit = (variance < np.float32(least_dn) ** 2) & (mean < np.float32(ceiling_dn))
    window = np.ones((TEXTURE_PX, TEXTURE_PX), np.uint8)
    return cv2.dilate(unlit.view(np.uint8), window).view(np.bool_)


def jump(disparity_px: NDArray[np.float32], *, range_px: float) -> NDArray[np.bool_]:
    """Reject pixels whose 3x3 neighbourhood spans more than `range_px` of disparity.

    The device reports no depth within 2 to 3 px of every depth edge, for jumps of any size.
    """
    known = np.isfinite(disparity_px)
    if not known.any() or np.nanmax(disparity_px) - np.nanmin(disparity_px) <= range_px:
        return np.zeros(known.shape, bool)
    kernel = np.ones((3, 3), np.uint8)
    high = cv2.dilate(np.where(known, disparity_px, np.float32(-1e6)), kernel)
    low = cv2.erode(np.where(known, disparity_px, np.float32(1e6)), kernel)
    return known & (high - low > range_px)


def unsupported(
    disparity_px: NDArray[np.float32], *, share: float, step_px: float
) -> NDArray[np.bool_]:
    """Reject pixels that too small a share of the neighbours in their window agrees with.

    Args:
        disparity_px: (h, w) [px], NaN where another check rejects it.
        share: least share of the window's other pixels within the image, 0 to 1; 0 accepts all.
        step_px: largest difference of disparities that agree [px].

    Source: librealsense presets.cpp, region support map: removeThresh 63 of 168, diffThresh 4.
    """
    out = np.zeros(disparity_px.shape, np.bool_)
    if share:
        _unsupported(disparity_px, np.float32(share), np.float32(step_px), SUPPORT_PX // 2, out)
    return out


@nb.njit(nogil=True, cache=True)
def _unsupported(disparity, share, step, reach, out):  # pragma: no cover - compiled
    h, w = disparity.shape
    count = np.empty(w, np.float32)
    for y in range(h):
        centre = disparity[y]
        first, last = max(0, y - reach), min(h, y + reach + 1)
        count[:] = np.float32(0)
        for row in range(first, last):
            for dx in range(max(-reach, 1 - w), min(reach, w - 1) + 1):
                start, end = max(0, -dx), min(w, w - dx)
                _count_like(disparity[row, start + dx : end + dx], centre[start:end], step,
                            count[start:end])  # fmt: skip
        for x in range(w):
            columns = min(w, x + reach + 1) - max(0, x - reach)
            others = np.float32((last - first) * columns - 1)
            out[y, x] = count[x] - np.float32(1) < share * others  # The pixel agrees with itself.


@nb.njit(nogil=True, cache=True)
def _count_like(values, centre, step, count):  # pragma: no cover - compiled
    """Count values within `step` of the centre; a separate function lets it vectorise."""
    for x in range(len(centre)):
        like = abs(values[x] - centre[x]) <= step  # False for NaN.
        count[x] += np.float32(1) if like else np.float32(0)


def speckle(disparity_px: NDArray[np.float32], *, count: int, step_px: float) -> NDArray[np.bool_]:
    """Reject islands of at most `count` pixels, bounded by disparity steps above `step_px`."""
    if not count:
        return np.zeros(disparity_px.shape, bool)
    valid = np.isfinite(disparity_px)
    fixed = np.where(valid, disparity_px * 16, _NONE).astype(np.int16)
    cv2.filterSpeckles(fixed, _NONE, count, step_px * 16)
    return valid & (fixed == _NONE)
