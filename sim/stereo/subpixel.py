"""Refinement of disparities after the winner is known.

Median, jump-preserving mean, the pull of a sub-pixel fit, rounding.
"""

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
    """Median over all winners, then the jump-preserving mean.

    The median runs before any check: it mends single wrong winners from their neighbours, as a
    matcher does that keeps a disparity for every pixel until the checks.

    Args:
        disparity_px: (h, w) [px], NaN where an engine gave none (kept so).
        weight: (h, w) how much each pixel counts in the mean, >= 0; None = all alike.
    """
    out = disparity_px
    if setting.median_px:
        known = np.isfinite(out)
        # An engine's holes must not pull the median: they are given back afterwards.
        out = cv2.medianBlur(np.where(known, out, np.float32(0)), setting.median_px)
        out = np.where(known & (out > 0), out, disparity_px)
    if setting.smooth_px > 1:
        weight = np.ones_like(out) if weight is None else weight
        out = smooth(
            out,
            weight,
            columns_px=setting.smooth_px,
            rows_px=min(setting.smooth_rows_px, setting.smooth_px),
            step_px=setting.smooth_step_px,
        )
    return out


def locked(disparity_px: NDArray[np.float32], amplitude_px: float) -> NDArray[np.float32]:
    """Pull disparities towards whole pixels: d - a sin(2 pi d).

    The parabola through three costs has an error that returns with every pixel and vanishes at
    whole and half ones; its first harmonic is the sine. Source: Shimizu and Okutomi 2005, IJCV
    63(3), "Sub-pixel estimation error cancellation on area-based matching"; that a sine fits the
    fractions of semi-global matching: Haller et al. 2010, ITSC. The mean comes first, so that the
    pull stands in the result with its full amplitude, whatever the noise.

    Args:
        disparity_px: (h, w) [px], NaN stays NaN.
        amplitude_px: a [px]; below 0 it pushes towards half pixels (an overdone correction), at 0
            the array itself comes back. Beyond 1 / (2 pi) disparities would change their order.
    """
    if not amplitude_px:
        return disparity_px
    turn = np.float32(2 * np.pi) * (disparity_px - np.rint(disparity_px))
    return disparity_px - np.float32(amplitude_px) * np.sin(turn)


def quantise(disparity_px: NDArray[np.float32], quantum_px: float) -> NDArray[np.float32]:
    """Round to multiples of `quantum_px` [px]; 0 leaves the values alone."""
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
) -> NDArray[np.float32]:
    """Weighted mean over a window, of neighbours within `step_px` of the centre.

    Taken along the rows and then along the columns of the result, which costs 2n instead of n^2.

    Args:
        disparity_px: (h, w) [px]; NaN stays NaN and counts nowhere.
        weight: (h, w) how much each pixel counts, >= 0; where all are 0 the centre stays.
        columns_px, rows_px: width and height of the window, odd.
        step_px: neighbours further off are left out.
    """
    across, down, step = columns_px // 2, rows_px // 2, np.float32(step_px)
    padded, weights = _padded(disparity_px, weight, 0, across)
    rows, gathered = _mean(padded, weights, disparity_px, 0, 2 * across, step)
    padded, weights = _padded(rows, gathered, down, 0)
    columns, _ = _mean(padded, weights, rows, 2 * down, 0, step)
    return columns


def _padded(
    disparity_px: NDArray, weight: NDArray, down: int, across: int
) -> tuple[NDArray, NDArray]:
    """Margins without disparity, so that they count nowhere."""
    margins = (down, down, across, across, cv2.BORDER_CONSTANT)
    return (
        cv2.copyMakeBorder(disparity_px, *margins, value=float("nan")),
        cv2.copyMakeBorder(weight, *margins, value=0),
    )


@nb.njit(nogil=True, cache=True)
def _mean(padded, weight, centre, down, across, step):  # pragma: no cover - compiled
    """Weighted means along one axis, and the weights gathered."""
    h, w = centre.shape
    out = np.empty((h, w), np.float32)
    gathered = np.zeros((h, w), np.float32)
    for y in range(h):
        total, count = np.zeros(w, np.float32), gathered[y]
        for dy in range(down + 1):
            for dx in range(across + 1):
                row, weights = padded[y + dy], weight[y + dy]
                for x in range(w):
                    # A difference to NaN is never small: holes count nowhere.
                    off = row[x + dx] - centre[y, x]
                    counts = weights[x + dx] if abs(off) <= step else np.float32(0)
                    total[x] += off * counts if counts > 0 else np.float32(0)
                    count[x] += counts
        for x in range(w):
            share = total[x] / count[x] if count[x] > 0 else np.float32(0)
            out[y, x] = centre[y, x] + share
    return out, gathered
