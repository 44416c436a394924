"""Semi-global selection on a cost volume: five scanline paths, winners, and the right view.

Paths come from the left, from the right, and from above (straight and both diagonals). No path
comes from below, because a camera's matcher processes rows as they arrive. Captures confirm it:
near edges lean down by 1 to 2 px (docs/design/matcher.md).
Source: Hirschmueller 2008, TPAMI 30(2).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.matcher import SubpixelFit
from starling.sim.stereo import paths
from starling.sim.stereo.lanes import (
    aligned_words,
    equal,
    least_lane,
    lesser,
    load_words,
    pick,
    read,
    splat_words,
    store_words,
)
from starling.sim.stereo.paths import LANES

BAND_ROWS = 8  # Rows of the volume in memory at a time.
_GROUP_ROWS = 4  # Rows whose horizontal paths advance in turn; their volume fits the cache.
_AHEAD = 2  # Bands prepared (cost, horizontal paths) while an earlier band is finished.
_RUN_PX = 64  # Columns between the steps of the selection; a multiple of _TURN_PX.
_TURN_PX = 4  # Columns that update the right view together.
_NONE = 65535  # Summed cost or column before any is known; above every other.
_u16 = np.uint16


class Winners(NamedTuple):
    """Result of the selection, each (h, w)."""

    best: NDArray[np.int16]  # Index of the best disparity in the search, 0 ... search - 1.
    offset: NDArray[np.float32]  # Sub-pixel part from the fitted cost, in [-1, 1] px.
    bend: NDArray[np.float32]  # Curvature of the fitted cost at the winner.
    right_best: NDArray[np.int16]  # Best index of the right view, -1 without a match.
    right_offset: NDArray[np.float32]  # Sub-pixel part of the right view, along the diagonal.
    margin_pct: NDArray[np.float32]  # Excess cost of the second best [percent of the best].
    second: NDArray[np.uint16]  # Excess cost of the second best, summed over the paths.
    neighbour: NDArray[np.uint16]  # Excess cost of the costlier neighbour of the best.


@nb.njit(nogil=True, cache=True)
def _fit(three, offset, bend, equal_slopes):  # pragma: no cover - compiled
    """Fit three costs (3, w): vertex in [-1, 1] px from the middle, curvature.

    The fit is a parabola, or a V whose slopes are equal.
    """
    for x in range(len(offset)):
        below, above = np.int32(three[0, x]), np.int32(three[2, x])
        curvature = max(below + above - np.int32(2) * np.int32(three[1, x]), np.int32(0))
        scale = max(below, above) - np.int32(three[1, x]) if equal_slopes else curvature
        vertex = np.float32(below - above) / np.float32(max(np.int32(2) * scale, np.int32(1)))
        vertex = min(np.float32(1), max(np.float32(-1), vertex))
        offset[x] = vertex if curvature > 0 else np.float32(0)
        bend[x] = np.float32(curvature)


@nb.njit(nogil=True, cache=True)
def _select(
    cost, total, costs, floors, first, sizes, p1, p2, shift, equal_slopes, of_sums,
    best_at, offset, bend, right, right_offset, margin, excess, neighbour,
):  # pragma: no cover - compiled  # fmt: skip
    """Finish the paths of a band of rows and choose the winners of both views."""
    w, search = sizes
    span = search + 2 * LANES
    # The sums of a run; margins above every sum hide what lies beside a pixel's disparities.
    sums = np.full((_RUN_PX + 1) * span, _u16(_NONE), np.uint16)
    reach = LANES + w + shift + span
    # Least sum of each right pixel and the left column that has it, mirrored.
    least, column = np.empty(reach, np.uint16), np.empty(reach, np.uint16)
    ramp = np.arange(search).astype(np.uint16)
    # Shifted to the winner, the mask hides it and its two neighbours without a branch in the loop.
    mask = np.zeros(2 * search + 1, np.uint16)
    mask[search - 1 : search + 2] = _u16(_NONE)
    three, three_r = np.empty((3, w), np.uint16), np.empty((3, w), np.uint16)
    peaks, unused = np.empty((3, w), np.uint16), np.empty(w, np.float32)
    for row in range(len(best_at)):
        y = first + row
        paths.enter_downward(costs, floors, y, w, search)
        least[:], column[:] = _u16(_NONE), _u16(_NONE)
        for start in range(0, w, _RUN_PX):
            stop = min(start + _RUN_PX, w)
            at = (row * w + start) * search
            for x in range(stop - start, _RUN_PX if stop == w else 0):
                sums[x * span : x * span + span] = _u16(_NONE)  # Columns right of the image.
            paths.sweep_down(
                cost, total, costs, floors, y, (start, stop), at, w, search, p1, p2, sums, span
            )
            _choose_left(
                sums, span, ramp, mask, cost, at, search, start, stop, best_at[row], peaks, three,
                of_sums,
            )  # fmt: skip
            _offer_right(sums, span, search, start, stop, w - 1 + shift + LANES, least, column)
        _choose_right(column, cost, row * w * search, shift, search, right[row], three_r)
        _fit(three, offset[row], bend[row], equal_slopes)
        _fit(three_r, right_offset[row], unused, equal_slopes and not of_sums)
        for x in range(w):
            lowest, second = peaks[0, x], peaks[1, x]
            excess[row, x], neighbour[row, x] = second - lowest, peaks[2, x] - lowest
            ratio = np.float32(second) / np.float32(max(lowest, _u16(1)))
            margin[row, x] = np.float32(100.0) * (ratio - np.float32(1.0))


@nb.njit(nogil=True, cache=True)
def _choose_left(
    sums, span, ramp, mask, cost, at, search, start, stop, best_at, peaks, three, from_sums
):  # pragma: no cover - compiled
    """Choose the winners of a run of columns in the left view.

    Args:
        sums: summed costs of the run, `span` apart.
        cost: flat support cost; the run starts at index `at`.
        best_at: filled with the winners.
        peaks: (3, w) filled with the sums of the best, the second best and the costlier neighbour.
        three: (3, w) filled with the cost below, at and above the winner; 0 at an end.
        from_sums: whether that is the summed cost; else it is the support cost.
    """
    none = splat_words(_u16(_NONE))
    for x in range(start, stop):
        first = (x - start) * span + LANES
        least = none
        for d in range(0, search, LANES):
            least = lesser(least, load_words(sums, first + d))
        lowest = least_lane(least)
        least = splat_words(lowest)
        place = none
        for d in range(0, search, LANES):
            winner = equal(load_words(sums, first + d), least)
            place = lesser(place, pick(winner, load_words(ramp, d), none))
        best_at[x] = least_lane(place)
        peaks[0, x] = lowest
    for x in range(start, stop):
        first, best = (x - start) * span + LANES, np.int64(best_at[x])
        rest = none
        for d in range(0, search, LANES):
            rest = lesser(rest, load_words(sums, first + d) | load_words(mask, search - best + d))
        peaks[1, x] = least_lane(rest)
        before = read(sums, first + max(best - 1, 0))
        peaks[2, x] = max(before, read(sums, first + min(best + 1, search - 1)))
        inside = 0 < best < search - 1
        here = (first if from_sums else at + (x - start) * search) + (best if inside else 1)
        source = sums if from_sums else cost
        three[0, x] = read(source, here - 1) if inside else _u16(0)
        three[1, x] = read(source, here) if inside else _u16(0)
        three[2, x] = read(source, here + 1) if inside else _u16(0)


@nb.njit(nogil=True, cache=True)
def _choose_right(column, cost, at, shift, search, right, three):  # pragma: no cover - compiled
    """Choose the winners of a row in the right view; fill `three` along the cost's diagonal."""
    w = len(right)
    for x in range(w):
        winner = np.int64(read(column, w - 1 - x + LANES))
        best = -1 if winner == _NONE else winner - x - shift
        right[x] = best
        inside = 0 < best < search - 1 and winner < w - 1
        here = at + winner * search + best if inside else at + search + 1
        three[0, x] = read(cost, here - search - 1) if inside else _u16(0)
        three[1, x] = read(cost, here) if inside else _u16(0)
        three[2, x] = read(cost, here + search + 1) if inside else _u16(0)


@nb.njit(nogil=True, cache=True)
def _offer_right(
    sums, span, search, start, stop, base, least, column
):  # pragma: no cover - compiled
    """Offer a run of columns to the right view; of equal sums the lower disparity remains.

    For each right pixel, columns come in the order of their disparities. Several columns share
    each visit of the right view's memory, because a visit waits for the one before.
    """
    for x in range(start, stop, _TURN_PX):
        a = (x - start) * span + LANES - 3
        b, c, d = a + span + 1, a + 2 * span + 2, a + 3 * span + 3
        column_a, column_b = splat_words(_u16(x)), splat_words(_u16(x + 1))
        column_c, column_d = splat_words(_u16(x + 2)), splat_words(_u16(x + 3))
        target = base - x - 3
        for k in range(0, search + LANES, LANES):
            before = load_words(least, target + k)
            known = load_words(column, target + k)
            after = lesser(before, load_words(sums, a + k))
            known = pick(equal(after, before), known, column_a)
            before = lesser(after, load_words(sums, b + k))
            known = pick(equal(after, before), known, column_b)
            after = lesser(before, load_words(sums, c + k))
            known = pick(equal(after, before), known, column_c)
            before = lesser(after, load_words(sums, d + k))
            known = pick(equal(after, before), known, column_d)
            store_words(least, target + k, before)
            store_words(column, target + k, known)


def select(
    cost: Callable[[int, NDArray[np.uint16]], None],
    shape: tuple[int, int, int],
    *,
    p1: int,
    p2: int,
    shift: int,
    fit: SubpixelFit = "parabola",
) -> Winners:
    """Choose the disparity of every pixel of the left and the right view.

    The right view's winner is the least total along the volume's diagonal, without a second
    matching. The sub-pixel part is fitted to the support cost: penalties distort the summed path
    costs and pull it towards whole pixels. All paths run along a row or downwards, so the volume is
    computed and discarded band by band.

    Args:
        cost: fills the support cost (rows, w, search) from an image row on.
        shape: h, w, search of the whole volume.
        p1, p2: penalties in the unit of the cost.
        shift: smallest disparity [px].
        fit: sub-pixel fit; "equal_slopes_of_sums" fits a V to the summed path costs of the left
            view. The right view then has a parabola.
    """
    h, w, search = shape
    winners = Winners(
        best=np.zeros((h, w), np.int16),
        offset=np.zeros((h, w), np.float32),
        bend=np.zeros((h, w), np.float32),
        right_best=np.full((h, w), -1, np.int16),
        right_offset=np.zeros((h, w), np.float32),
        margin_pct=np.zeros((h, w), np.float32),
        second=np.zeros((h, w), np.uint16),
        neighbour=np.zeros((h, w), np.uint16),
    )
    penalties = (_u16(p1), _u16(p2))
    # Threads per band: a parallel kernel needs a barrier per row, which stalls on a busy machine.
    volumes = aligned_words(_AHEAD + 1, 2, min(h, BAND_ROWS), w, search)
    downward = paths.start_downward(w, search)

    def prepare(band: int) -> tuple[NDArray, NDArray]:
        start = band * BAND_ROWS
        support, total = volumes[band % (_AHEAD + 1), :, : min(BAND_ROWS, h - start)]
        for row in range(0, len(support), _GROUP_ROWS):
            group, sums = support[row : row + _GROUP_ROWS], total[row : row + _GROUP_ROWS]
            cost(start + row, group)
            paths.sweep_sideways(group.reshape(-1), sums.reshape(-1), w, search, *penalties)
        return support.reshape(-1), total.reshape(-1)

    bands = range(-(-h // BAND_ROWS))
    with ThreadPoolExecutor(1) as pool:  # A single thread: the cost continues from row to row.
        ready = [pool.submit(prepare, band) for band in bands[:_AHEAD]]
        for band in bands:
            support, total = ready[band].result()
            start = band * BAND_ROWS
            part = slice(start, start + BAND_ROWS)
            views = [view[part] for view in winners]
            limits = (
                (w, search),
                *penalties,
                shift,
                fit != "parabola",
                fit == "equal_slopes_of_sums",
            )
            _select(support, total, *downward, start, *limits, *views)
            if band + _AHEAD in bands:
                ready.append(pool.submit(prepare, band + _AHEAD))
    return winners
