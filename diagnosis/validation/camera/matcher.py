"""The withheld device's matcher: semi-global matching of centre-symmetric census strings.

Hirschmueller 2008 (TPAMI 30(2)) on eight paths, with the census of Spangenberg et al. 2013 (CAIP),
which compares opposite pixels of a window with each other and not all with the middle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import disparity_filters
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

Infrared = NDArray[np.uint8] | NDArray[np.uint16]
Map = NDArray[np.float64]

# The device's settings, which no effect moves.
_SEARCH = 128  # Disparities tried, from 0 on.
_CENSUS_PX = 7  # Side of the window.
_SMALL_PENALTY = np.uint8(4)  # Price of a step of one disparity [bit].
_LARGE_PENALTY = np.uint8(24)  # Price of a larger one [bit].
_UNIQUENESS = 0.1  # By how much of the winner's cost the second best must cost more.
_LEFT_RIGHT_PX = 1.0  # Largest difference of both views.
_MEDIAN_PX = 3  # Side of the window.
_SPECKLE_COUNT = 60  # Largest island that is removed [px].
_SPECKLE_STEP_PX = 1.0
_NO_COST = np.iinfo(np.uint16).max


def depth(ir_left: Infrared, ir_right: Infrared, nominal: Nominal) -> NDArray[np.float32]:
    """Match a pair and triangulate.

    Args:
        ir_left: Left image (h, w) [DN].
        ir_right: Right image.
        nominal: Gives focal length and baseline.

    Returns:
        Depth z [m] (h, w), NaN where there is none.

    Raises:
        WithheldError: if the images differ in shape or are narrower than half the search.
    """
    disparity_px = match(ir_left, ir_right)
    seen = np.where(disparity_px > 0, disparity_px, np.nan)
    return (nominal.focal_baseline_px_m / seen).astype(np.float32)


def match(ir_left: Infrared, ir_right: Infrared) -> Map:
    """Match a pair: disparity (h, w) [px], NaN where a check refuses it; refuses as `depth`."""
    if ir_left.shape != ir_right.shape:
        raise refusal("pair", "must share one shape", (ir_left.shape, ir_right.shape), "Crop.")
    if ir_left.shape[1] <= _SEARCH // 2:
        raise refusal("images", f"must be wider than {_SEARCH // 2} px", ir_left.shape, "Widen.")
    total = _aggregate(_costs(ir_left, ir_right))
    best, least = _winner(total)
    found = disparity_filters.median(best + _parabola(total, best), _MEDIAN_PX)
    refused = _ambiguous(total, best, least)
    refused |= _disagrees(found, _right_winner(total))
    refused |= (best == 0) | (best == len(total) - 1)
    found = np.where(refused, np.nan, found)
    return disparity_filters.without_islands(found, _SPECKLE_COUNT, _SPECKLE_STEP_PX)


def _census(image: Infrared) -> NDArray[np.uint64]:
    """Which of each two opposite pixels of the window is brighter, a bit each."""
    reach = _CENSUS_PX // 2
    padded = np.pad(image, reach, mode="edge")
    height, width = image.shape
    pairs = [(y, x) for y in range(-reach, reach + 1) for x in range(-reach, reach + 1)]
    bits = np.zeros(image.shape, np.uint64)
    for y, x in pairs[: len(pairs) // 2]:
        one = padded[reach + y : reach + y + height, reach + x : reach + x + width]
        other = padded[reach - y : reach - y + height, reach - x : reach - x + width]
        bits = (bits << np.uint64(1)) | (one > other)
    return bits


def _costs(left: Infrared, right: Infrared) -> NDArray[np.uint8]:
    """Bits that differ (n, h, w); outside the overlap as many as strangers have, half of all."""
    bits_left, bits_right = _census(left), _census(right)
    costs = np.full((_SEARCH, *left.shape), _CENSUS_PX**2 // 4, np.uint8)
    width = left.shape[1]
    for d in range(min(_SEARCH, width)):
        costs[d, :, d:] = np.bitwise_count(bits_left[:, d:] ^ bits_right[:, : width - d])
    return costs


def _aggregate(costs: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Sum of the paths' costs (n, h, w) (Hirschmueller 2008, eq. 13)."""
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
    """Add the paths that run from row to row, `lean` columns aside at each step.

    Less their least, costs of a path are at most 24 bits and P2; with P1 on top they fit in 8 bits.
    """
    path = costs[:, 0].copy()
    total[:, 0] += path
    for row in range(1, costs.shape[1]):
        path -= path.min(0)
        if lean:
            path = np.roll(path, lean, 1)
            path[:, 0 if lean > 0 else -1] = 0  # A path that begins here owes nothing.
        step = np.minimum(path, _LARGE_PENALTY)
        dear = path + _SMALL_PENALTY
        np.minimum(step[1:], dear[:-1], out=step[1:])
        np.minimum(step[:-1], dear[1:], out=step[:-1])
        path = step + costs[:, row]
        total[:, row] += path


def _winner(total: NDArray[np.uint16]) -> tuple[NDArray[np.intp], NDArray[np.uint16]]:
    """Cheapest disparity of each pixel, and its cost (h, w)."""
    least = total[0].copy()
    best = np.zeros(least.shape, np.intp)
    for d in range(1, len(total)):
        lower = total[d] < least
        np.copyto(least, total[d], where=lower)
        best[lower] = d
    return best, least


def _right_winner(total: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Cheapest disparity (h, w) of the right image's pixels, from the same costs."""
    width = total.shape[2]
    least = np.full(total.shape[1:], _NO_COST, np.uint16)
    best = np.zeros(least.shape, np.int64)
    for d, plane in enumerate(total[:width]):
        lower = plane[:, d:] < least[:, : width - d]
        np.copyto(least[:, : width - d], plane[:, d:], where=lower)
        best[:, : width - d][lower] = d
    return best


def _parabola(total: NDArray[np.uint16], best: NDArray[np.intp]) -> Map:
    """Vertex between the winner and the two beside it, in -1/2 to 1/2 [px]."""
    inner = np.clip(best, 1, len(total) - 2)[None]
    before, at, after = (
        np.take_along_axis(total, inner + i, 0)[0].astype(np.float64) for i in (-1, 0, 1)
    )
    bend = before + after - 2.0 * at
    vertex = 0.5 * (before - after) / np.where(bend > 0, bend, 1.0)
    return np.where((bend > 0) & (best == inner[0]), np.clip(vertex, -0.5, 0.5), 0.0)


def _ambiguous(
    total: NDArray[np.uint16], best: NDArray[np.intp], least: NDArray[np.uint16]
) -> NDArray[np.bool_]:
    """Pixels (h, w) where a disparity not beside the winner costs hardly more."""
    limit = least * (1.0 + _UNIQUENESS)
    rivals = np.zeros(best.shape, np.int16)
    for plane in total:
        rivals += plane < limit
    for aside in (-1, 0, 1):
        at = best + aside
        held = (at >= 0) & (at < len(total))
        beside = np.take_along_axis(total, np.clip(at, 0, len(total) - 1)[None], 0)[0]
        rivals -= held & (beside < limit)
    return rivals > 0


def _disagrees(found: Map, right: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pixels (h, w) whose match in the right image has another disparity, or does not exist."""
    rows, columns = np.indices(found.shape)
    place = columns - np.rint(found).astype(np.int64)
    away = np.abs(right[rows, np.clip(place, 0, None)] - found)
    return (place < 0) | (away > _LEFT_RIGHT_PX)
