"""Averaging of the cost over a support region that ends at steps of brightness.

Cross-based support: Zhang, Lu and Lafruit 2009 (IEEE TCSVT 19(7)); in AD-Census: Mei et al. 2011.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.census import cost_row

COST_SCALE = 32  # Levels per bit in the averaged cost; the sub-pixel fit needs fractions of a bit.
ROW_SCALE = 16  # Levels per bit in the rows' means; a sum of 15 means fits 16 bits.
_u8, _u16, _u32 = np.uint8, np.uint16, np.uint32
_WAYS = np.array([(0, -1), (0, 1), (-1, 0), (1, 0)])  # West, east, north, south as (dy, dx).


def arms(level: NDArray[np.uint16], *, step: int, reach: int) -> NDArray[np.uint8]:
    """Return the lengths of every pixel's four arms, within which brightness differs by <= `step`.

    Args:
        level: (h, w) uint16 brightness.
        step: largest difference to the arm's root, in the levels of `level`.
        reach: longest arm [px]; arms also end at the image's border.

    Returns:
        (4, h, w) uint8: west, east, north, south.
    """
    return _arms(level, np.int32(step), reach, _WAYS)


@nb.njit(nogil=True, cache=True)
def _arms(level, step, reach, ways):  # pragma: no cover - compiled
    h, w = level.shape
    out = np.zeros((4, h, w), np.uint8)
    for way in range(4):
        dy, dx = ways[way]
        for y in range(h):
            grows = np.ones(w, np.uint8)
            for length in range(1, min(reach, w - 1) + 1):
                if not 0 <= y + dy * length < h:
                    break
                west, east = max(0, -dx * length), max(0, dx * length)
                grows[:west], grows[w - east :] = 0, 0
                roots, tips = level[y, west : w - east], level[y + dy * length, east : w - west]
                on, lengths = grows[west : w - east], out[way, y, west : w - east]
                for x in range(len(roots)):
                    away = abs(np.int32(tips[x]) - np.int32(roots[x]))
                    on[x] &= _u8(away <= step)
                    lengths[x] += on[x]
    return out


@nb.njit(inline="always")
def _mean(first, last, share, out):  # pragma: no cover - compiled
    """Mean between two running sums; the sums may wrap around, their difference does not."""
    for d in range(out.shape[0]):
        out[d] = _u16(_u32(_u32(_u16(last[d] - first[d])) * share) >> _u32(16))


@nb.njit(nogil=True, cache=True)
def support_cost(
    bits, bits_r, dn, dn_r, pad, weight, cap, arm, reach, start, out
):  # pragma: no cover - compiled
    """Average the cost along the horizontal arms, then the means along the vertical arms.

    Only the rows that the arms span are stored, so any band of rows can be computed separately.
    Running sums make the time independent of the arms' lengths.

    Args:
        bits, dn: (h, w) census and brightness [DN] of the left image, uint64 and uint8.
        bits_r, dn_r: (h, w + pad + search) of the right image, mirrored, last column repeated.
        pad: smallest disparity [px].
        weight: weight of the brightness difference [1/16 bit per DN].
        cap: largest difference that counts [DN].
        arm: (4, h, w) from `arms`.
        reach: longest arm [px].
        start: image row of the first row of `out`.
        out: (rows, w, search) uint16, filled with the cost, COST_SCALE per bit.
    """
    h = bits.shape[0]
    rows, w, search = out.shape
    stored = 2 * reach + 2
    sums = np.zeros((stored, w, search), np.uint16)  # Down the rows.
    along = np.zeros((w + 1, search), np.uint16)  # Along one row.
    cost, mean = np.zeros((w, search), np.uint8), np.zeros(search, np.uint16)
    for y in range(max(0, start - reach), start + rows + reach):
        if y < h:
            cost_row(bits[y], bits_r[y], dn[y], dn_r[y], pad, weight, cap, cost)
            for x in range(w):
                for d in range(search):
                    along[x + 1, d] = _u16(along[x, d] + cost[x, d])
            for x in range(w):
                first, last = x - arm[0, y, x], x + arm[1, y, x] + 1
                _mean(along[first], along[last], _u32((ROW_SCALE << 16) // (last - first)), mean)
                above, current = sums[(y - 1) % stored, x], sums[y % stored, x]
                for d in range(search):
                    current[d] = _u16(above[d] + mean[d])
        done = y - reach
        if done < start:
            continue
        for x in range(w):
            before, last = done - arm[2, done, x] - 1, done + arm[3, done, x]
            share = _u32(((COST_SCALE // ROW_SCALE) << 16) // (last - before))
            _mean(sums[before % stored, x], sums[last % stored, x], share, out[done - start, x])
