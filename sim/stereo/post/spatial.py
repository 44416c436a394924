"""Spatial filter: edge-preserving recursive smoothing along rows and columns; fills holes."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

_MOST = 254  # Most pixels that the last mode fills from one side.
_LAST_MODE = 5


def smooth(
    disparity_px: NDArray[np.float32],
    *,
    alpha: float,
    delta_px: float,
    iterations: int,
    holes: int = 0,
) -> NDArray[np.float32]:
    """Smooth along rows and columns in both directions, restarting at every edge.

    One pass: out[i] = alpha in[i] + (1 - alpha) out[i - 1] if |in[i] - in[i - 1]| < `delta_px`,
    otherwise out[i] = in[i]. An iteration has four passes: rightwards, leftwards, downwards,
    upwards. Passes also restart after missing disparities.

    White noise well below delta loses the same share of variance along rows and columns. With
    |H|^2 = alpha^2 / (1 + b^2 - 2 b cos w) and b = 1 - alpha, n iterations leave the mean over w
    of |H|^(4n) along each axis.

    Args:
        disparity_px: (h, w) [px], NaN = none.
        alpha: weight of the pixel itself, (0, 1]; 1 returns the input array.
        delta_px: a difference of at least this between neighbours is an edge [px].
        iterations: number of iterations.
        holes: mode of hole filling, see `Post.spatial_holes`.

    Returns:
        (h, w) [px], NaN where the input is NaN and no hole is filled.

    Source: Gastal and Oliveira 2011, Domain transform for edge-aware image and video processing,
    sec. 5 (recursive filter). As in librealsense, differences are taken before the pass, and all
    edges have equal strength.
    """
    if alpha == 1.0:
        return disparity_px
    out = np.array(disparity_px, np.float32, order="C")
    weight, delta = np.float32(alpha), np.float32(delta_px)
    across = np.empty(out.shape[::-1], np.float32)
    for _ in range(iterations):
        # Transposed, columns become rows, so that neighbouring lines are processed together.
        cv2.transpose(out, dst=across)
        _down_and_up(across, weight, delta)
        cv2.transpose(across, dst=out)
        _down_and_up(out, weight, delta)
    if holes:
        _fill_along_rows(out.ravel(), out.shape[1], _MOST if holes == _LAST_MODE else 2**holes - 1)
    return out


@nb.njit(nogil=True, cache=True)
def _fill_along_rows(image, width, most):  # pragma: no cover - compiled
    """Fill at most `most` pixels of each hole rightwards, and then leftwards, in place.

    The last pixel of a row is filled from the next row's first one, as in librealsense.
    """
    for start in range(0, image.size, width):
        filled = 0
        for i in range(start + 1, start + width):
            filled = filled + 1 if image[i] != image[i] else 0
            if 0 < filled <= most:
                image[i] = image[i - 1]
        filled = 0
        for i in range(start + width - 1, start, -1):
            filled = filled + 1 if image[i] != image[i] else 0
            if 0 < filled <= most and i + 1 < image.size:
                image[i] = image[i + 1]


@nb.njit(nogil=True, cache=True)
def _down_and_up(image, alpha, delta):  # pragma: no cover - compiled
    """Pass downwards and then upwards, in place."""
    h, w = image.shape
    before = np.empty(w, np.float32)  # The previous row, as it was before the pass.
    for upwards in range(2):
        y, step = (h - 1, -1) if upwards else (0, 1)
        before[:] = image[y]
        for _ in range(h - 1):
            _take_over(image[y], before, image[y + step], alpha, delta)
            y += step


@nb.njit(nogil=True, cache=True)
def _take_over(done, before, row, alpha, delta):  # pragma: no cover - compiled
    """Smooth one row with the previous one; a separate function lets the compiler vectorise."""
    rest = np.float32(1) - alpha
    for x in range(row.size):
        value = row[x]
        near = abs(value - before[x]) < delta  # False for NaN, so a hole ends a run.
        before[x] = value
        row[x] = alpha * value + rest * done[x] if near else value
