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

_u16, _u32 = np.uint16, np.uint32
_WALL = 40_000  # Cost outside the searched range: above any real cost, far from overflow.
BAND_ROWS = 48  # Rows of the volume in memory at a time; they fit the cache.
_AHEAD = 2  # Bands prepared (cost, horizontal paths) while an earlier band is finished.


class Winners(NamedTuple):
    """Result of the selection, each (h, w)."""

    best: NDArray[np.int16]  # Index of the best disparity in the search, 0 ... search - 1.
    offset: NDArray[np.float32]  # Sub-pixel part from the support cost, in [-1, 1] px.
    bend: NDArray[np.float32]  # Curvature of the support cost at the winner.
    right_best: NDArray[np.int16]  # Best index of the right view, -1 without a match.
    right_offset: NDArray[np.float32]  # Sub-pixel part of the right view, along the diagonal.
    margin_pct: NDArray[np.float32]  # Excess cost of the second best [percent of the best].
    second: NDArray[np.uint16]  # Excess cost of the second best, summed over the paths.
    neighbour: NDArray[np.uint16]  # Excess cost of the costlier neighbour of the best.


@nb.njit(inline="always")
def _advance(before, floor, cost, now, total, p1, p2):  # pragma: no cover - compiled
    """Advance a path by one pixel: fill `now`, add it to `total`, return the least of `now`."""
    search = cost.shape[0]
    jump = _u16(floor + p2)
    least = _u16(65535)
    for d in range(search):
        step = min(_u16(before[d] + p1), _u16(before[d + 2] + p1))
        best = min(min(before[d + 1], step), jump)
        value = _u16(_u16(best - floor) + cost[d])
        now[d + 1] = value
        total[d] = _u16(total[d] + value)
        least = min(least, value)
    return least


@nb.njit(nogil=True, cache=True)
def _sweep_sideways(cost, total, p1, p2):  # pragma: no cover - compiled
    """Fill `total` with the summed costs of the two horizontal paths."""
    rows, w, search = cost.shape
    for y in range(rows):
        a = np.full(search + 2, _WALL, np.uint16)
        b = np.full(search + 2, _WALL, np.uint16)
        total[y] = 0
        for leftward in range(2):
            a[1 : search + 1] = 0
            floor = _u16(0)
            for i in range(w):
                x = w - 1 - i if leftward else i
                floor = _advance(a, floor, cost[y, x], b, total[y, x], p1, p2)
                a, b = b, a


@nb.njit(nogil=True, cache=True)
def _sweep_down(cost, total, p1, p2, state, floor, start):  # pragma: no cover - compiled
    """Add the costs of the three downward paths (straight and both diagonals) to `total`.

    Args:
        state: (2, 3, w + 2, search + 2) costs of each path along the last even and the last odd
            row. They have a margin of one column and one disparity on each side.
        floor: (2, 3, w + 2) least cost of each path.
        start: image row of the first row of `cost`.
    """
    rows, w, _ = cost.shape
    for y in range(rows):
        current = (start + y) % 2
        above = 1 - current
        for x in range(w):
            for path in range(3):
                source = x + path  # Columns x - 1, x, x + 1 of the row above.
                floor[current, path, x + 1] = _advance(
                    state[above, path, source],
                    floor[above, path, source],
                    cost[y, x],
                    state[current, path, x + 1],
                    total[y, x],
                    p1,
                    p2,
                )


@nb.njit(inline="always")
def _parabola(below, middle, above):  # pragma: no cover - compiled
    """Fit a parabola through three costs: vertex in [-1, 1] px from the middle, and curvature."""
    bend = np.int64(below) + np.int64(above) - 2 * np.int64(middle)
    if bend <= 0:
        return 0.0, 0.0
    return min(1.0, max(-1.0, (np.int64(below) - np.int64(above)) / (2.0 * bend))), float(bend)


@nb.njit(nogil=True, cache=True)
def _select(
    total, cost, best_at, offset, bend, right, right_offset, margin, excess, neighbour, shift
):  # pragma: no cover - compiled
    h, w, search = total.shape
    # Shifted to the winner, the mask hides it and its two neighbours without a branch in the loop.
    wall = np.zeros(2 * search + 1, np.uint16)
    wall[search - 1 : search + 2] = _u16(65535)
    for y in range(h):
        # Cost and index share one number, so that its minimum has the lowest best index.
        best_right = np.full(w + shift + search, _u32(0xFFFFFFFF), np.uint32)
        for x in range(w):
            row = total[y, x]
            mirror = best_right[w - 1 - x + shift : w - 1 - x + shift + search]
            least = _u32(0xFFFFFFFF)
            for d in range(search):
                key = _u32((_u32(row[d]) << _u32(8)) | _u32(d))
                least = min(least, key)
                mirror[d] = min(mirror[d], key)
            best = np.int64(least & _u32(255))
            second, hidden = _u16(65535), wall[search - best : 2 * search - best]
            for d in range(search):
                second = min(second, _u16(row[d] | hidden[d]))
            best_at[y, x] = best
            excess[y, x] = _u16(second - row[best])
            before, after = row[max(best - 1, 0)], row[min(best + 1, search - 1)]
            neighbour[y, x] = _u16(max(before, after) - row[best])
            lowest = np.float32(max(row[best], _u16(1)))
            margin[y, x] = np.float32(100.0) * (np.float32(second) / lowest - np.float32(1.0))
            if 0 < best < search - 1:
                fine = cost[y, x]
                offset[y, x], bend[y, x] = _parabola(fine[best - 1], fine[best], fine[best + 1])
        for x in range(w):
            key = best_right[w - 1 - x]
            best = -1 if key == _u32(0xFFFFFFFF) else np.int64(key & _u32(255))
            right[y, x] = best
            left_column = x + shift + best  # Column in the left image.
            if 0 < best < search - 1 and left_column < w - 1:
                below, above = (
                    cost[y, left_column - 1, best - 1],
                    cost[y, left_column + 1, best + 1],
                )
                right_offset[y, x], _ = _parabola(below, cost[y, left_column, best], above)


def select(
    cost: Callable[[int, NDArray[np.uint16]], None],
    shape: tuple[int, int, int],
    *,
    p1: int,
    p2: int,
    shift: int,
) -> Winners:
    """Choose the disparity of every pixel of the left and the right view.

    The right view's winner is the least total along the volume's diagonal, without a second
    matching. The sub-pixel part is fitted to the support cost: penalties distort the summed path
    costs and pull the fit towards whole pixels. All paths run along a row or downwards, so
    the volume is computed and discarded band by band.

    Args:
        cost: fills the support cost (rows, w, search) from an image row on.
        shape: h, w, search of the whole volume.
        p1, p2: penalties in the unit of the cost.
        shift: smallest disparity [px].
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
    volumes = np.empty((_AHEAD + 1, 2, min(h, BAND_ROWS), w, search), np.uint16)
    state = np.full((2, 3, w + 2, search + 2), _WALL, np.uint16)
    state[:, :, :, 1:-1] = 0  # Paths start with zero cost.
    floor = np.zeros((2, 3, w + 2), np.uint16)

    def prepare(band: int) -> tuple[NDArray, NDArray]:
        start = band * BAND_ROWS
        support, total = volumes[band % (_AHEAD + 1), :, : min(BAND_ROWS, h - start)]
        cost(start, support)
        _sweep_sideways(support, total, *penalties)
        return support, total

    bands = range(-(-h // BAND_ROWS))
    with ThreadPoolExecutor(_AHEAD) as pool:
        ready = [pool.submit(prepare, band) for band in bands[:_AHEAD]]
        for band in bands:
            support, total = ready[band].result()
            if band + _AHEAD in bands:
                ready.append(pool.submit(prepare, band + _AHEAD))
            start = band * BAND_ROWS
            _sweep_down(support, total, *penalties, state, floor, start)
            part = slice(start, start + len(support))
            _select(
                total,
                support,
                winners.best[part],
                winners.offset[part],
                winners.bend[part],
                winners.right_best[part],
                winners.right_offset[part],
                winners.margin_pct[part],
                winners.second[part],
                winners.neighbour[part],
                shift,
            )
    return winners
