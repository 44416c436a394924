"""Semi-global selection on a cost volume: five scanline paths, the winner, and the right view.

Paths: from the left, from the right, and down from above (straight and both diagonals). None comes
from below: a camera's matcher reads rows as they arrive, and the captures show it (near edges
lean down by 1 to 2 px, docs/decisions/0003-matcher.md). Source: Hirschmueller 2008, TPAMI 30(2).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

_u16, _u32 = np.uint16, np.uint32
_WALL = 40_000  # Cost outside the searched range: above any real one, far from overflow.
BAND_ROWS = 48  # So many rows of the volume exist at a time: they fit the cache.
_AHEAD = 2  # Bands whose cost and sideways paths are made while an earlier one is finished.


class Winners(NamedTuple):
    """What the selection found, all (h, w)."""

    best: NDArray[np.int16]  # Best disparity's place in the search, 0 ... search - 1.
    offset: NDArray[np.float32]  # Sub-pixel part from the support's cost, in [-1, 1] px.
    bend: NDArray[np.float32]  # Curvature of that cost at the winner: how sharp the fit is.
    right_best: NDArray[np.int16]  # The same for the right view, -1 where nothing maps.
    right_offset: NDArray[np.float32]  # And its sub-pixel part, along the same diagonal.
    margin_pct: NDArray[np.float32]  # How much more the second best costs [percent of best].
    second: NDArray[np.uint16]  # The same in the cost's unit, summed over the paths.
    neighbour: NDArray[np.uint16]  # How much more the dearer disparity beside the best costs.


@nb.njit(inline="always")
def _advance(before, floor, cost, now, total, p1, p2):  # pragma: no cover - compiled
    """One pixel along one path: fill `now`, add it to `total`, return the least of `now`."""
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
    """Fill `total` with the sum of the two horizontal paths' costs."""
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
    """Add the three downward paths' costs to `total` (straight, and both diagonals).

    Args:
        state: (2, 3, w + 2, search + 2) costs of each path along the last two rows, one column
            and one disparity of margin either side; even rows in the first half, odd in the other.
        floor: (2, 3, w + 2) their least cost.
        start: image row of the first row of `cost`.
    """
    rows, w, _ = cost.shape
    for y in range(rows):
        here = (start + y) % 2
        above = 1 - here
        for x in range(w):
            for path in range(3):
                source = x + path  # Columns x - 1, x, x + 1 of the row above.
                floor[here, path, x + 1] = _advance(
                    state[above, path, source],
                    floor[above, path, source],
                    cost[y, x],
                    state[here, path, x + 1],
                    total[y, x],
                    p1,
                    p2,
                )


@nb.njit(inline="always")
def _parabola(below, at, above):  # pragma: no cover - compiled
    """Vertex of the parabola through three costs, in [-1, 1] px from the middle, and its bend."""
    bend = np.int64(below) + np.int64(above) - 2 * np.int64(at)
    if bend <= 0:
        return 0.0, 0.0
    return min(1.0, max(-1.0, (np.int64(below) - np.int64(above)) / (2.0 * bend))), float(bend)


@nb.njit(nogil=True, cache=True)
def _select(
    total, cost, best_at, offset, bend, right, right_offset, margin, excess, beside, shift
):  # pragma: no cover - compiled
    h, w, search = total.shape
    # Moved to the winner it hides that and the two beside it: a loop without branches.
    wall = np.zeros(2 * search + 1, np.uint16)
    wall[search - 1 : search + 2] = _u16(65535)
    for y in range(h):
        # Cost and index in one number, so that the least number names the lowest best index.
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
            beside[y, x] = _u16(max(before, after) - row[best])
            lowest = np.float32(max(row[best], _u16(1)))
            margin[y, x] = np.float32(100.0) * (np.float32(second) / lowest - np.float32(1.0))
            if 0 < best < search - 1:
                fine = cost[y, x]
                offset[y, x], bend[y, x] = _parabola(fine[best - 1], fine[best], fine[best + 1])
        for x in range(w):
            key = best_right[w - 1 - x]
            best = -1 if key == _u32(0xFFFFFFFF) else np.int64(key & _u32(255))
            right[y, x] = best
            seen = x + shift + best  # Its column in the left image.
            if 0 < best < search - 1 and seen < w - 1:
                below, above = cost[y, seen - 1, best - 1], cost[y, seen + 1, best + 1]
                right_offset[y, x], _ = _parabola(below, cost[y, seen, best], above)


def select(
    cost: Callable[[int, NDArray[np.uint16]], None],
    shape: tuple[int, int, int],
    *,
    p1: int,
    p2: int,
    shift: int,
) -> Winners:
    """Choose the disparity of every pixel, seen from the left and from the right.

    The right view's winner is the least total along the volume's diagonal: no second matching.
    The sub-pixel part is fitted to the support's own cost, because the summed paths' cost is bent
    by the penalties and pulls towards whole pixels. As every path runs along a row or downwards,
    the volume is made and forgotten band by band.

    Args:
        cost: fills the support cost (rows, w, search) from the given image row on.
        shape: h, w, search of the whole volume.
        p1, p2: penalties in the cost's unit. shift: smallest disparity [px].
    """
    h, w, search = shape
    found = Winners(
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
    # Plain threads, not a parallel kernel: a barrier for every row stalls on a busy machine.
    volumes = np.empty((_AHEAD + 1, 2, min(h, BAND_ROWS), w, search), np.uint16)
    state = np.full((2, 3, w + 2, search + 2), _WALL, np.uint16)
    state[:, :, :, 1:-1] = 0  # A path that starts costs nothing yet.
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
                found.best[part],
                found.offset[part],
                found.bend[part],
                found.right_best[part],
                found.right_offset[part],
                found.margin_pct[part],
                found.second[part],
                found.neighbour[part],
                shift,
            )
    return found
