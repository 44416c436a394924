"""Spatial filter: edge-preserving smoothing by recursive passes along rows and columns."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray


def smooth(
    disparity_px: NDArray[np.float32], *, alpha: float, delta_px: float, iterations: int
) -> NDArray[np.float32]:
    """Smooth along rows and columns, forth and back, and start afresh at every edge.

    One pass: out[i] = alpha in[i] + (1 - alpha) out[i - 1] where in[i] and in[i - 1] differ by
    less than `delta_px`, else out[i] = in[i]. An iteration makes four: rightwards, leftwards,
    downwards, upwards. Where there is no disparity the passes start afresh; nothing is filled.

    White noise that nowhere reaches delta loses the same share of its variance along rows and
    columns: n iterations of gain |H|^2 = alpha^2 / (1 + b^2 - 2 b cos w), b = 1 - alpha, leave
    the mean over w of |H|^(4n) along each.

    Args:
        disparity_px: (h, w) [px], NaN = none.
        alpha: share of the pixel itself, (0, 1]; 1 gives the input itself.
        delta_px: neighbours at least this far apart are an edge [px].
        iterations: of the four passes.

    Returns:
        (h, w) [px], NaN where the input is.

    Source: Gastal and Oliveira 2011, Domain transform for edge-aware image and video processing,
    sec. 5 (recursive filter), in librealsense's form: its filter compares the values before the
    pass, and all its edges are alike.
    """
    if alpha == 1.0:
        return disparity_px
    out = np.array(disparity_px, np.float32, order="C")
    weight, delta = np.float32(alpha), np.float32(delta_px)
    across = np.empty(out.shape[::-1], np.float32)
    for _ in range(iterations):
        # Rows of the transposed image are columns: neighbouring lines are then worked on at once.
        cv2.transpose(out, dst=across)
        _down_and_up(across, weight, delta)
        cv2.transpose(across, dst=out)
        _down_and_up(out, weight, delta)
    return out


@nb.njit(nogil=True, cache=True)
def _down_and_up(image, alpha, delta):  # pragma: no cover - compiled
    """Pass downwards and then upwards, in place."""
    h, w = image.shape
    before = np.empty(w, np.float32)  # The previous row before the pass.
    for upwards in range(2):
        y, step = (h - 1, -1) if upwards else (0, 1)
        before[:] = image[y]
        for _ in range(h - 1):
            _take_over(image[y], before, image[y + step], alpha, delta)
            y += step


@nb.njit(nogil=True, cache=True)
def _take_over(done, before, here, alpha, delta):  # pragma: no cover - compiled
    """Smooth one row by the one before it; a function of its own runs on many pixels at once."""
    rest = np.float32(1) - alpha
    for x in range(here.size):
        value = here[x]
        near = abs(value - before[x]) < delta  # NaN is near nothing, so it ends a run.
        before[x] = value
        here[x] = alpha * value + rest * done[x] if near else value
