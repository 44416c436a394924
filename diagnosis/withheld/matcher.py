"""The withheld device's matcher: semi-global matching of centre-symmetric census strings.

Hirschmueller 2008 (TPAMI 30(2)) on eight paths, with the census of Spangenberg et al. 2013 (CAIP),
which compares opposite pixels of a window with each other and not all with the middle.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from diagnosis.withheld import disparity_filters
from diagnosis.withheld.case import Case
from diagnosis.withheld.errors import refusal
from diagnosis.withheld.nominal import Nominal

Infrared = NDArray[np.uint8] | NDArray[np.uint16]
Map = NDArray[np.float64]

_TEXTURE_PX = 15  # Side of the window whose contrast is asked for.
_DEAREST = 255 - 60  # P1 and P2 together, beside the bits of the largest census.
_NO_COST = np.iinfo(np.uint16).max


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """Settings of the matcher; those that are effects are called as these."""

    search_range: int = 128  # Tried, from `disparity_shift` on.
    disparity_shift: int = 0  # [px]
    census_window: int = 7  # Side [px], odd, at most 11.
    small_penalty: int = 4  # Price of a step of one disparity [bit].
    large_penalty: int = 24  # Price of a larger one [bit].
    uniqueness: float = 10.0  # How far the second best must cost more [%].
    left_right_threshold: float = 1.0  # Largest difference of both views [px].
    texture_threshold: float = 0.0  # Least standard deviation in 15x15 [DN of 8 bits].
    median: int = 3  # Side [px]; 0 is off.
    speckle_count: int = 60  # Largest island removed [px].
    speckle_step_px: float = 1.0

    def __post_init__(self) -> None:
        if self.census_window not in (3, 5, 7, 9, 11):
            raise refusal("census_window", "must be odd, 3 to 11", self.census_window, "Change it.")
        if not 1 <= self.small_penalty <= self.large_penalty <= _DEAREST - self.small_penalty:
            raise refusal(
                "penalties",
                f"must be 1 <= small <= large, together at most {_DEAREST}",
                (self.small_penalty, self.large_penalty),
                "Change one.",
            )
        if not 4 <= self.search_range <= 256 or self.disparity_shift < 0:
            raise refusal(
                "search",
                "must be of 4 to 256 disparities from 0 or more",
                (self.search_range, self.disparity_shift),
                "Change it.",
            )


def settings_for(case: Case, settings: Settings | None = None) -> Settings:
    """Take over those of a case's strengths that this matcher has settings for.

    An effect that is taken over here must not be applied to the matched depth once more.
    """
    settings = settings or Settings()
    kinds = {item.name: item.default for item in dataclasses.fields(Settings)}
    changes = {
        name: round(value) if isinstance(kinds[name], int) else value
        for name, value in case.settings.items()
        if name in kinds
    }
    return dataclasses.replace(settings, **changes)


def depth(
    ir_left: Infrared, ir_right: Infrared, nominal: Nominal, *, settings: Settings | None = None
) -> NDArray[np.float32]:
    """Match a pair and triangulate.

    Args:
        ir_left: Left image (h, w) [DN].
        ir_right: Right image.
        nominal: Gives focal length and baseline.
        settings: The matcher's.

    Returns:
        Depth z [m] (h, w), NaN where there is none.

    Raises:
        WithheldError: if the images differ in shape or are narrower than the search.
    """
    disparity_px = match(ir_left, ir_right, settings or Settings())
    scale = 255.0 / (2.0**nominal.bit_depth - 1.0)
    least = (settings or Settings()).texture_threshold
    if least > 0:
        disparity_px = np.where(contrast(ir_left) * scale < least, np.nan, disparity_px)
    seen = np.where(disparity_px > 0, disparity_px, np.nan)
    return (nominal.focal_baseline_px_m / seen).astype(np.float32)


def match(ir_left: Infrared, ir_right: Infrared, settings: Settings) -> Map:
    """Match a pair: disparity (h, w) [px], NaN where a check refuses it."""
    if ir_left.shape != ir_right.shape:
        raise refusal("pair", "must share one shape", (ir_left.shape, ir_right.shape), "Crop.")
    if ir_left.shape[1] <= settings.disparity_shift + settings.search_range // 2:
        raise refusal("images", "must be wider than half the search", ir_left.shape, "Search less.")
    costs = _costs(ir_left, ir_right, settings)
    total = _aggregate(costs, settings)
    best, least = _winner(total)
    found = best + _parabola(total, best)
    right = _right_winner(total, settings.disparity_shift)
    found = disparity_filters.median(found, settings.median)
    found += settings.disparity_shift
    refused = _ambiguous(total, best, least, settings.uniqueness)
    refused |= _disagrees(found, right, settings)
    refused |= (best == 0) | (best == len(total) - 1)
    found = np.where(refused, np.nan, found)
    return disparity_filters.without_islands(
        found, settings.speckle_count, settings.speckle_step_px
    )


def contrast(image: Infrared) -> Map:
    """Standard deviation in a 15x15 window about every pixel (h, w) [DN]."""
    values = image.astype(np.float64)
    mean = ndimage.uniform_filter(values, _TEXTURE_PX)
    square = ndimage.uniform_filter(values**2, _TEXTURE_PX)
    return np.sqrt(np.maximum(square - mean**2, 0.0))


def _census(image: Infrared, side: int) -> NDArray[np.uint64]:
    """Which of each two opposite pixels of the window is brighter, a bit each."""
    reach = side // 2
    padded = np.pad(image, reach, mode="edge")
    height, width = image.shape
    pairs = [(y, x) for y in range(-reach, reach + 1) for x in range(-reach, reach + 1)]
    bits = np.zeros(image.shape, np.uint64)
    for y, x in pairs[: len(pairs) // 2]:
        one = padded[reach + y : reach + y + height, reach + x : reach + x + width]
        other = padded[reach - y : reach - y + height, reach - x : reach - x + width]
        bits = (bits << np.uint64(1)) | (one > other)
    return bits


def _costs(left: Infrared, right: Infrared, settings: Settings) -> NDArray[np.uint8]:
    """Bits that differ (n, h, w); outside the overlap as many as strangers have, half of all."""
    bits_left = _census(left, settings.census_window)
    bits_right = _census(right, settings.census_window)
    strangers = settings.census_window**2 // 4
    costs = np.full((settings.search_range, *left.shape), strangers, np.uint8)
    width = left.shape[1]
    for number in range(settings.search_range):
        d = number + settings.disparity_shift
        if d < width:
            costs[number, :, d:] = np.bitwise_count(bits_left[:, d:] ^ bits_right[:, : width - d])
    return costs


def _aggregate(costs: NDArray[np.uint8], settings: Settings) -> NDArray[np.uint16]:
    """Sum of the paths' costs (n, h, w) (Hirschmueller 2008, eq. 13)."""
    total = np.zeros(costs.shape, np.uint16)
    for lean in (-1, 0, 1):
        _sweep(costs, total, lean, settings)
        _sweep(costs[:, ::-1], total[:, ::-1], lean, settings)
    across = np.ascontiguousarray(costs.swapaxes(1, 2))
    total_across = np.zeros(across.shape, np.uint16)
    _sweep(across, total_across, 0, settings)
    _sweep(across[:, ::-1], total_across[:, ::-1], 0, settings)
    total += total_across.swapaxes(1, 2)
    return total


def _sweep(
    costs: NDArray[np.uint8], total: NDArray[np.uint16], lean: int, settings: Settings
) -> None:
    """Add the paths that run from row to row, `lean` columns aside at each step.

    Less their least, costs of a path are at most 60 bits and P2; with P1 on top they fit in 8 bits.
    """
    small = np.uint8(settings.small_penalty)
    large = np.uint8(settings.large_penalty)
    path = costs[:, 0].copy()
    total[:, 0] += path
    for row in range(1, costs.shape[1]):
        path -= path.min(0)
        if lean:
            path = np.roll(path, lean, 1)
            path[:, 0 if lean > 0 else -1] = 0  # A path that begins here owes nothing.
        step = np.minimum(path, large)
        dear = path + small
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


def _right_winner(total: NDArray[np.uint16], shift: int) -> NDArray[np.int64]:
    """Cheapest disparity (h, w) of the right image's pixels, from the same costs."""
    width = total.shape[2]
    least = np.full(total.shape[1:], _NO_COST, np.uint16)
    best = np.zeros(least.shape, np.int64)
    for number, plane in enumerate(total):
        d = number + shift
        if d >= width:
            break
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
    total: NDArray[np.uint16],
    best: NDArray[np.intp],
    least: NDArray[np.uint16],
    percent: float,
) -> NDArray[np.bool_]:
    """Pixels (h, w) where a disparity not beside the winner costs hardly more."""
    if percent == 0:
        return np.zeros(best.shape, bool)
    limit = least * (1.0 + 0.01 * percent)
    rivals = np.zeros(best.shape, np.int16)
    for plane in total:
        rivals += plane < limit
    for aside in (-1, 0, 1):
        at = best + aside
        held = (at >= 0) & (at < len(total))
        beside = np.take_along_axis(total, np.clip(at, 0, len(total) - 1)[None], 0)[0]
        rivals -= held & (beside < limit)
    return rivals > 0


def _disagrees(found: Map, right: NDArray[np.int64], settings: Settings) -> NDArray[np.bool_]:
    """Pixels (h, w) whose match in the right image has another disparity, or does not exist."""
    rows, columns = np.indices(found.shape)
    place = columns - np.rint(found).astype(np.int64)
    away = np.abs(right[rows, np.clip(place, 0, None)] - found)
    # The right view's disparities are whole: half a pixel is what rounding alone makes.
    return (place < 0) | (away > max(settings.left_right_threshold, 0.5))
