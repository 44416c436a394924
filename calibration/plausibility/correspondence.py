"""Where windows of the left image lie in the right one, without knowing any depth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import WINDOW_PX, high_passed
from starling.patterns.errors import refuse

Array = NDArray[np.float32]

_ROWS, _COLUMNS = 20, 24  # Windows looked for.
_REACH = 4  # Disparities up to a quarter of the image's width, either sign.
_ROWS_OFF_PX = 2  # Rows by which a pair may be off its rectification.
_LEAST = 0.6  # NCC from which a window counts as found ...
_SECOND = 0.8  # ... if the next best place has less than this share of it.
_PEAK_PX = 4  # Places this near the best one are the same peak.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Correspondences:
    """Windows of 31 x 31 px of the left image that were found in the right one, n of `tried`."""

    row: NDArray[np.intp]  # (n,) Centres in the left image [px].
    column: NDArray[np.intp]  # (n,)
    disparity_px: Array  # (n,) x_left - x_right, sub-pixel, of either sign.
    patch: Array  # (n, 31, 31) Mean of both high-passed images: their noise does not agree.
    tried: int

    def __len__(self) -> int:
        return len(self.row)


def find(left: NDArray, right: NDArray) -> Correspondences:
    """Look for 20 x 24 windows of the left image along the rows of the right one.

    Both images are high-passed; the best place by normalised cross-correlation counts if it
    reaches 0.6 and no other place reaches 0.8 of it. Disparities up to a quarter of the
    width are looked for, negative ones too (images may be swapped), and rows up to 2 px off.

    Args:
        left: (h, w) [DN].
        right: (h, w).

    Raises:
        InputError: if the images differ in shape or are smaller than 64 x 64.
    """
    if left.shape != right.shape or min(left.shape) < 2 * (WINDOW_PX + 1):
        raise refuse(
            "left and right",
            "must share one shape of at least 64x64",
            f"{left.shape}, {right.shape}",
            "Give a rectified pair.",
        )
    one, other = high_passed(left), high_passed(right)
    height, width = one.shape
    half = WINDOW_PX // 2
    edge = half + _ROWS_OFF_PX
    rows = np.unique(np.linspace(edge, height - 1 - edge, _ROWS).astype(int))
    columns = np.unique(np.linspace(half, width - 1 - half, _COLUMNS).astype(int))
    found = [_place(one, other, int(row), int(column)) for row, column in product(rows, columns)]
    kept = [place for place in found if place is not None]
    return Correspondences(
        row=np.array([place[0] for place in kept], np.intp),
        column=np.array([place[1] for place in kept], np.intp),
        disparity_px=np.array([place[2] for place in kept], np.float32),
        patch=np.array([place[3] for place in kept], np.float32).reshape(-1, WINDOW_PX, WINDOW_PX),
        tried=len(found),
    )


def _place(one: Array, other: Array, row: int, column: int) -> tuple[int, int, float, Array] | None:
    """Centre, disparity and mean patch of one window; None where it is not found."""
    half, reach = WINDOW_PX // 2, one.shape[1] // _REACH
    first = max(0, column - reach - half)
    window = one[row - half : row + half + 1, column - half : column + half + 1]
    top = row - half - _ROWS_OFF_PX
    strip = other[top : row + half + 1 + _ROWS_OFF_PX, first : column + reach + half + 1]
    score = cv2.matchTemplate(strip, window, cv2.TM_CCOEFF_NORMED)
    down, across = np.unravel_index(int(score.argmax()), score.shape)
    best = float(score[down, across])
    sub = _peak(score[down, max(0, across - 1) : across + 2])
    beside = score.copy()
    beside[:, max(0, across - _PEAK_PX) : across + _PEAK_PX + 1] = -1
    if not best >= _LEAST or beside.max() > _SECOND * best:
        return None
    matched = strip[down : down + WINDOW_PX, across : across + WINDOW_PX]
    disparity = column - (first + float(across) + sub + half)
    return row, column, disparity, np.float32(0.5) * (window + matched)


def _peak(three: NDArray) -> float:
    """Vertex of the parabola through three values, about the middle one; 0 at a border."""
    if len(three) < 3:
        return 0.0
    curve = float(three[0] - 2 * three[1] + three[2])
    return 0.5 * float(three[0] - three[2]) / curve if curve < 0 else 0.0
