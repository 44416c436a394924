"""A second stereo matcher: semi-global matching of centre-symmetric census strings.

Semi-global matching follows Hirschmueller 2008 (TPAMI 30(2)) with eight paths. The census of
Spangenberg et al. 2013 (CAIP) compares opposite pixels of a window, not each pixel with the centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import depth_filters
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

Infrared = NDArray[np.uint8] | NDArray[np.uint16]
Map = NDArray[np.float64]

# Fixed settings of the device; no effect changes them.
_SEARCH = 128  # Number of disparities, from 0.
_CENSUS_PX = 7  # Side of the census window [px].
_SMALL_PENALTY = np.uint8(4)  # P1: penalty of a disparity step of 1 px [bit].
_LARGE_PENALTY = np.uint8(24)  # P2: penalty of a larger step [bit].
_UNIQUENESS = 0.1  # Relative cost margin that the second best disparity must exceed.
_LEFT_RIGHT_PX = 1.0  # Largest difference in the left-right check [px].
_MEDIAN_PX = 3  # Side of the median window [px].
_SPECKLE_COUNT = 60  # Largest island that is removed [px].
_SPECKLE_STEP_PX = 1.0  # Largest step within an island [px].
_NO_COST = np.iinfo(np.uint16).max


def depth(ir_left: Infrared, ir_right: Infrared, nominal: Nominal) -> NDArray[np.float32]:
    """Match a pair and triangulate.

    Args:
        ir_left: Left image (h, w) [DN].
        ir_right: Right image (h, w) [DN].
        nominal: Camera that gives focal length and baseline.

    Returns:
        Depth z (h, w) [m], NaN where there is none.

    Raises:
        WithheldError: if the images differ in shape or are narrower than half the search.
    """
    disparity_px = match(ir_left, ir_right)
    positive = np.where(disparity_px > 0, disparity_px, np.nan)
    return (nominal.focal_baseline_px_m / positive).astype(np.float32)


def match(ir_left: Infrared, ir_right: Infrared) -> Map:
    """Return the disparity (h, w) [px] of a pair, NaN where a check rejects it.

    Raises:
        WithheldError: as for `depth`.
    """
    if ir_left.shape != ir_right.shape:
        raise refusal("pair", "must share one shape", (ir_left.shape, ir_right.shape), "Crop.")
    if ir_left.shape[1] <= _SEARCH // 2:
        raise refusal("images", f"must be wider than {_SEARCH // 2} px", ir_left.shape, "Widen.")
    total = _aggregate(_costs(ir_left, ir_right))
    best, least = total.argmin(0), total.min(0)
    disparity_px = depth_filters.median(best + _parabola(total, best), _MEDIAN_PX)
    rejected = _ambiguous(total, best, least)
    rejected |= _disagrees(disparity_px, _right_winner(total))
    rejected |= (best == 0) | (best == len(total) - 1)
    disparity_px = np.where(rejected, np.nan, disparity_px)
    return depth_filters.without_islands(disparity_px, _SPECKLE_COUNT, _SPECKLE_STEP_PX)


def _census(image: Infrared) -> NDArray[np.uint64]:
    """Compute census strings: one bit compares each pair of opposite pixels of the window."""
    reach = _CENSUS_PX // 2
    padded = np.pad(image, reach, mode="edge")
    height, width = image.shape
    pairs = [(y, x) for y in range(-reach, reach + 1) for x in range(-reach, reach + 1)]
    bits = np.zeros(image.shape, np.uint64)
    for y, x in pairs[: len(pairs) // 2]:
        pixel = padded[reach + y : reach + y + height, reach + x : reach + x + width]
        opposite = padded[reach - y : reach - y + height, reach - x : reach - x + width]
        bits = (bits << np.uint64(1)) | (pixel > opposite)
    return bits


def _costs(left: Infrared, right: Infrared) -> NDArray[np.uint8]:
    """Hamming distances (n, h, w); outside the overlap half of all bits, as of random strings."""
    bits_left, bits_right = _census(left), _census(right)
    costs = np.full((_SEARCH, *left.shape), _CENSUS_PX**2 // 4, np.uint8)
    width = left.shape[1]
    for d in range(min(_SEARCH, width)):
        costs[d, :, d:] = np.bitwise_count(bits_left[:, d:] ^ bits_right[:, : width - d])
    return costs


def _aggregate(costs: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Sum the path costs (n, h, w) (Hirschmueller 2008, eq. 13)."""
    total = np.zeros(costs.shape, np.uint16)
    for lean in (-1, 0, 1):
        _sweep(costs, total, lean)
        _sweep(costs[:, ::-1], total[:, ::-1], lean)
    across = np.ascontiguousarray(costs.swapaxes(1, 2))
    total_across = np.zeros(across.shape, np.uint16)
    _sweep(across, total_across, 0)
    _sweep(across[:, ::-1], total_across[:, ::-1], 0)
    total += total_across.swapaxes(1, 2)
    return total


def _sweep(costs: NDArray[np.uint8], total: NDArray[np.uint16], lean: int) -> None:
    """Add the costs of the paths that run from row to row, `lean` columns sideways per step.

    Path costs less their minimum are at most 24 bits plus P2. With P1 added they fit in 8 bits.
    """
    path = costs[:, 0].copy()
    total[:, 0] += path
    for row in range(1, costs.shape[1]):
        path -= path.min(0)
        if lean:
            path = np.roll(path, lean, 1)
            path[:, 0 if lean > 0 else -1] = 0  # A path that starts here has no previous cost.
        step = np.minimum(path, _LARGE_PENALTY)
        neighbour = path + _SMALL_PENALTY
        np.minimum(step[1:], neighbour[:-1], out=step[1:])
        np.minimum(step[:-1], neighbour[1:], out=step[:-1])
        path = step + costs[:, row]
        total[:, row] += path


def _right_winner(total: NDArray[np.uint16]) -> NDArray[np.intp]:
    """Find the disparity of least cost (h, w) of the right image from the same costs."""
    width = total.shape[2]
    costs = np.full_like(total, _NO_COST)
    for d in range(min(len(total), width)):
        costs[d, :, : width - d] = total[d, :, d:]
    return costs.argmin(0)


def _parabola(total: NDArray[np.uint16], best: NDArray[np.intp]) -> Map:
    """Fit a parabola to the winner and its neighbours; vertex in -1/2 to 1/2 [px]."""
    inner = np.clip(best, 1, len(total) - 2)[None]
    before, middle, after = (
        np.take_along_axis(total, inner + i, 0)[0].astype(np.float64) for i in (-1, 0, 1)
    )
    bend = before + after - 2.0 * middle
    vertex = 0.5 * (before - after) / np.where(bend > 0, bend, 1.0)
    return np.where((bend > 0) & (best == inner[0]), np.clip(vertex, -0.5, 0.5), 0.0)


def _ambiguous(
    total: NDArray[np.uint16], best: NDArray[np.intp], least: NDArray[np.uint16]
) -> NDArray[np.bool_]:
    """Mask (h, w) of pixels where a disparity away from the winner costs hardly more."""
    limit = least * (1.0 + _UNIQUENESS)
    candidates = (total < limit).sum(0)
    for step in (-1, 0, 1):
        disparity = best + step
        inside = (disparity >= 0) & (disparity < len(total))
        cost = np.take_along_axis(total, np.clip(disparity, 0, len(total) - 1)[None], 0)[0]
        candidates -= inside & (cost < limit)
    return candidates > 0


def _disagrees(disparity_px: Map, right: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask (h, w) of pixels that fail the left-right check or match outside the right image."""
    rows, columns = np.indices(disparity_px.shape)
    match_x = columns - np.rint(disparity_px).astype(np.int64)
    difference_px = np.abs(right[rows, np.clip(match_x, 0, None)] - disparity_px)
    return (match_x < 0) | (difference_px > _LEFT_RIGHT_PX)
