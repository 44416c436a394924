"""Match windows of the left image in the right one, without any depth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import WINDOW_PX, high_passed
from starling.patterns.errors import refuse

Array = NDArray[np.float32]

_ROWS, _COLUMNS = 20, 24  # Grid of windows.
_REACH = 4  # Search range: image width over this, for either sign of disparity.
_ROWS_OFF_PX = 2  # Permitted vertical error of the rectification.
_LEAST = 0.6  # Minimum NCC of a match.
_SECOND = 0.8  # Maximum NCC of the second best position, relative to the best.
_PEAK_PX = 4  # Positions within this distance belong to the same peak.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Correspondences:
    """Windows of 31 x 31 px of the left image with a match in the right one, n of `tried`."""

    row: NDArray[np.intp]  # (n,) Centres in the left image [px].
    column: NDArray[np.intp]  # (n,)
    disparity_px: Array  # (n,) x_left - x_right, sub-pixel, of either sign.
    patch: Array  # (n, 31, 31) Mean of both high-passed images, which reduces noise.
    tried: int

    def __len__(self) -> int:
        return len(self.row)


def find(left: NDArray, right: NDArray) -> Correspondences:
    """Search 20 x 24 windows of the left image along the rows of the right one.

    Both images are high-passed. The best position by normalised cross-correlation is a match if
    its score is at least 0.6, and no other position reaches 0.8 of it. The search covers
    disparities up to a quarter of the width of either sign, because images may be swapped. It
    covers vertical errors up to 2 px.

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
    left_high, right_high = high_passed(left), high_passed(right)
    height, width = left_high.shape
    half = WINDOW_PX // 2
    edge = half + _ROWS_OFF_PX
    rows = np.unique(np.linspace(edge, height - 1 - edge, _ROWS).astype(int))
    columns = np.unique(np.linspace(half, width - 1 - half, _COLUMNS).astype(int))
    places = [
        _place(left_high, right_high, int(row), int(column))
        for row, column in product(rows, columns)
    ]
    matches = [place for place in places if place is not None]
    return Correspondences(
        row=np.array([place[0] for place in matches], np.intp),
        column=np.array([place[1] for place in matches], np.intp),
        disparity_px=np.array([place[2] for place in matches], np.float32),
        patch=np.array([place[3] for place in matches], np.float32).reshape(
            -1, WINDOW_PX, WINDOW_PX
        ),
        tried=len(places),
    )


def _place(
    left_high: Array, right_high: Array, row: int, column: int
) -> tuple[int, int, float, Array] | None:
    """Return centre, disparity and mean patch of a window; None without a match."""
    half, reach = WINDOW_PX // 2, left_high.shape[1] // _REACH
    first = max(0, column - reach - half)
    window = left_high[row - half : row + half + 1, column - half : column + half + 1]
    top = row - half - _ROWS_OFF_PX
    strip = right_high[top : row + half + 1 + _ROWS_OFF_PX, first : column + reach + half + 1]
    score = cv2.matchTemplate(strip, window, cv2.TM_CCOEFF_NORMED)
    down, across = np.unravel_index(int(score.argmax()), score.shape)
    best = float(score[down, across])
    sub = _peak(score[down, max(0, across - 1) : across + 2])
    elsewhere = score.copy()
    elsewhere[:, max(0, across - _PEAK_PX) : across + _PEAK_PX + 1] = -1
    if not best >= _LEAST or elsewhere.max() > _SECOND * best:
        return None
    matched = strip[down : down + WINDOW_PX, across : across + WINDOW_PX]
    disparity = column - (first + float(across) + sub + half)
    return row, column, disparity, np.float32(0.5) * (window + matched)


def _peak(three: NDArray) -> float:
    """Return the vertex of the parabola through three values, from the middle; 0 at a border."""
    if len(three) < 3:
        return 0.0
    curve = float(three[0] - 2 * three[1] + three[2])
    return 0.5 * float(three[0] - three[2]) / curve if curve < 0 else 0.0
