"""Refinement of disparities: median, edge-preserving mean, pixel locking, quantisation."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.matcher import Refinement


def refine(
    disparity_px: NDArray[np.float32],
    setting: Refinement,
    weight: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Apply the median to all winners, then the edge-preserving mean.

    The median runs before any check and replaces single wrong winners by their neighbours.

    Args:
        disparity_px: (h, w) [px]; NaN without disparity stays NaN.
        setting: window sizes and steps.
        weight: (h, w) weight of each pixel in the mean, >= 0; None weights all equally.
    """
    out = disparity_px
    if setting.median_px:
        known = np.isfinite(out)
        # Holes count as 0 in the median and are restored afterwards.
        filled = out if known.all() else np.where(known, out, np.float32(0))
        out = np.asarray(cv2.medianBlur(filled, setting.median_px), np.float32)
        np.copyto(out, disparity_px, where=~known | (out <= 0))
    if setting.smooth_px <= 1:
        return out
    return smooth(
        out,
        np.ones_like(out) if weight is None else weight,
        columns_px=setting.smooth_px,
        rows_px=min(setting.smooth_rows_px, setting.smooth_px),
        step_px=setting.smooth_step_px,
        quantum_px=setting.mean_quantum_px,
    )


def apply_pixel_locking(
    disparity_px: NDArray[np.float32], amplitude_px: float
) -> NDArray[np.float32]:
    """Apply pixel locking, a bias of disparities towards whole pixels: d - a sin(2 pi d).

    The error of a parabola fit is periodic in the pixel and vanishes at whole and half pixels;
    the sine is its first harmonic. It follows the mean, so that its amplitude in the result does
    not depend on noise.

    Args:
        disparity_px: (h, w) [px], NaN stays NaN.
        amplitude_px: a [px]. Negative values push towards half pixels (an overdone correction); 0
            returns the input array. Above 1 / (2 pi) disparities would change their order.

    Source: Shimizu and Okutomi 2005, IJCV 63(3), "Sub-pixel estimation error cancellation on
    area-based matching". Haller et al. 2010, ITSC: a sine fits semi-global matching.
    """
    if not amplitude_px:
        return disparity_px
    turn = np.float32(2 * np.pi) * (disparity_px - np.rint(disparity_px))
    return disparity_px - np.float32(amplitude_px) * np.sin(turn)


def quantise(disparity_px: NDArray[np.float32], quantum_px: float) -> NDArray[np.float32]:
    """Round to multiples of `quantum_px` [px]; 0 returns the input array."""
    if not quantum_px:
        return disparity_px
    quantum = np.float32(quantum_px)
    return np.rint(disparity_px / quantum) * quantum


def smooth(
    disparity_px: NDArray[np.float32],
    weight: NDArray[np.float32],
    *,
    columns_px: int,
    rows_px: int,
    step_px: float,
    quantum_px: float,
) -> NDArray[np.float32]:
    """Return the weighted mean over a window, of neighbours within `step_px` of the centre.

    The mean is separable: along rows, then along columns, with cost 2n instead of n^2.

    Args:
        disparity_px: (h, w) [px]; NaN stays NaN and has no weight.
        weight: (h, w) weight of each pixel, >= 0; if all are 0 the centre is unchanged.
        columns_px: width of the window, odd [px].
        rows_px: its height [px]; an even one has one row more above the centre than below.
        step_px: neighbours with a larger difference are left out [px].
        quantum_px: step of the shift by the mean along columns [px]; 0 is none.
    """
    h, w = disparity_px.shape
    out = np.empty((h, w), np.float32)
    steps = np.float32(step_px), np.float32(quantum_px)
    _smooth(disparity_px, weight, columns_px // 2, rows_px, *steps, out)
    return out


@nb.njit(nogil=True, cache=True)
def _smooth(disparity, weight, across, size, step, quantum, out):  # pragma: no cover - compiled
    """Fill `out` with the means along rows, then along columns; a ring holds the rows' means."""
    h, w = disparity.shape
    up, down = size // 2, (size - 1) // 2
    means, gathered = np.empty((size, w), np.float32), np.empty((size, w), np.float32)
    total, count = np.empty(w, np.float32), np.empty(w, np.float32)
    for last in range(h + down):
        if last < h:
            centre, at = disparity[last], last % size
            total[:], gathered[at] = np.float32(0), np.float32(0)
            for dx in range(max(-across, 1 - w), min(across, w - 1) + 1):
                first, end = max(0, -dx), min(w, w - dx)
                others = slice(first + dx, end + dx)
                _add(disparity[last, others], weight[last, others], centre[first:end], step,
                     total[first:end], gathered[at, first:end])  # fmt: skip
            _finish(centre, total, gathered[at], np.float32(0), means[at])
        y = last - down
        if y >= 0:
            centre = means[y % size]
            total[:], count[:] = np.float32(0), np.float32(0)
            for row in range(max(0, y - up), min(h, y + down + 1)):
                _add(means[row % size], gathered[row % size], centre, step, total, count)
            _finish(centre, total, count, quantum, out[y])


@nb.njit(nogil=True, cache=True)
def _add(values, weight, centre, step, total, count):  # pragma: no cover - compiled
    """Add the weighted differences to the centre of values within `step` of it."""
    for x in range(len(centre)):
        # A difference to NaN never passes the threshold, so holes have no weight.
        off = values[x] - centre[x]
        counts = weight[x] if abs(off) <= step else np.float32(0)
        total[x] += off * counts if counts > 0 else np.float32(0)
        count[x] += counts


@nb.njit(nogil=True, cache=True)
def _finish(centre, total, count, quantum, out):  # pragma: no cover - compiled
    for x in range(len(centre)):
        shift = total[x] / count[x] if count[x] > 0 else np.float32(0)
        if quantum > 0:
            shift = np.rint(shift / quantum) * quantum
        out[x] = centre[x] + shift
