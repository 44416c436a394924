"""Checks of an imported pair: are its rows aligned, does it show dots, is depth in its unit?

Windows of the left image are searched in the right one, in a band of rows around their own. The
vertical offset is 0 in a rectified pair. The disparity d gives the depth f b / d,
with which the device's depth is compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.captures.png import GreyImage
from starling.sim.scene.captured import room_light

_WINDOW_PX = 41  # Side of a window; it holds several dots.
_BAND_PX = 6  # Vertical search range, up and down.
_GRID = (9, 12)  # Rows and columns of windows.
_SEARCHED = 0.35  # Largest disparity, in image widths.
_NEGATIVE_PX = 24  # Search range of negative disparities, which swapped images have.
_FEWEST = 8  # Windows below which nothing is concluded.
_CORRELATION = 0.7  # Least correlation of a window that was found.
_DISTINCT = 0.06  # Least lead over the second peak, in correlation.
_AROUND_PX = 16.0  # Sigma of the neighbourhood of the dots' share, a few dots wide [px].
_LEAST_DN = 0.1  # Least light that is divided by [DN].
_APART_PX = 5  # A second peak is farther from the first than this.


@dataclass(frozen=True, kw_only=True, slots=True)
class PairFigures:
    """What was seen in one infrared pair; None where too few windows were found."""

    windows: int
    row_offset_px: float | None = None  # Median vertical offset, right minus left.
    row_spread_px: float | None = None  # Largest offset of a quarter of the image from 0.
    disparity_px: float | None = None  # Median.
    depth_ratio: float | None = None  # Median of depth over f b / d.


def pair_figures(
    left: GreyImage,
    right: GreyImage,
    *,
    depth_m: Image | None = None,
    focal_baseline_px_m: float = 0.0,
) -> PairFigures:
    """Find windows of the left image in the right one.

    Args:
        left: (h, w).
        right: (h, w).
        depth_m: depth of the left view [m], NaN where unknown.
        focal_baseline_px_m: f b [px m].
    """
    matches = _matches(left.astype(np.float32), right.astype(np.float32))
    if len(matches) < _FEWEST:
        return PairFigures(windows=len(matches))
    y, x, disparity, offset = matches.T
    height, width = left.shape
    quarters = (y > height / 2).astype(int) * 2 + (x > width / 2)
    medians = [
        float(np.median(offset[quarters == quarter]))
        for quarter in range(4)
        if (quarters == quarter).sum() >= 3
    ]
    ratio = None
    if depth_m is not None:
        seen = depth_m[y.astype(int), x.astype(int)]
        known = np.isfinite(seen) & (disparity > 1)
        if known.sum() >= _FEWEST:
            ratio = float(np.median(seen[known] * disparity[known] / focal_baseline_px_m))
    return PairFigures(
        windows=len(matches),
        row_offset_px=float(np.median(offset)),
        row_spread_px=max(map(abs, medians), default=None),
        disparity_px=float(np.median(disparity)),
        depth_ratio=ratio,
    )


def _matches(left: Image, right: Image) -> NDArray[np.float64]:
    """Return row, column, disparity and vertical offset (n, 4) of the windows that are found."""
    height, width = left.shape
    half = _WINDOW_PX // 2
    edge = half + _BAND_PX
    rows = np.linspace(edge, height - 1 - edge, _GRID[0]).astype(int)
    columns = np.linspace(half, width - 1 - half, _GRID[1]).astype(int)
    if height < 2 * edge + 1 or width < 2 * _WINDOW_PX:
        return np.zeros((0, 4))
    matches = []
    for y in rows:
        for x in columns:
            window = left[y - half : y + half + 1, x - half : x + half + 1]
            first = max(0, x - half - int(_SEARCHED * width))
            last = min(width, x + half + 1 + _NEGATIVE_PX)
            band = right[y - edge : y + edge + 1, first:last]
            if window.std() < 1e-6 or band.std() < 1e-6:
                continue
            score = cv2.matchTemplate(band, window, cv2.TM_CCOEFF_NORMED)
            place = _peak(np.asarray(score, np.float32))
            if place is not None:
                matches.append((y, x, x - half - first - place[1], place[0] - _BAND_PX))
    return np.array(matches, np.float64).reshape(-1, 4)


def _peak(score: Image) -> tuple[float, float] | None:
    """Return row and column of a distinct maximum, with sub-pixel offsets; None without one."""
    _, best, _, (x, y) = cv2.minMaxLoc(score)
    if best < _CORRELATION or not np.isfinite(best):
        return None
    rest = score.copy()
    rest[:, max(x - _APART_PX, 0) : x + _APART_PX + 1] = -1
    if best - float(rest.max()) < _DISTINCT:
        return None
    return y + _vertex(score[:, x], y), x + _vertex(score[y], x)


def _vertex(line: Image, place: int) -> float:
    """Offset of a parabola's maximum through three values; 0 at an end."""
    if not 0 < place < len(line) - 1:
        return 0.0
    before, middle, after = (float(value) for value in line[place - 1 : place + 2])
    bend = before - 2 * middle + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def dot_share(image: GreyImage, black_level_dn: float = 0.0) -> float:
    """Return the share of light in round spots, median over the image.

    Args:
        image: (h, w).
        black_level_dn: pedestal of the image [DN].
    """
    level = np.maximum(image.astype(np.float32) - np.float32(black_level_dn), 0)
    spots = np.maximum(level - room_light.remove_dots(level), 0)
    around = [cv2.GaussianBlur(light, (0, 0), _AROUND_PX) for light in (spots, level)]
    return float(np.median(around[0] / np.maximum(around[1], _LEAST_DN)))
