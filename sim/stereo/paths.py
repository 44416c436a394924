"""Scanline paths of semi-global matching: costs along five directions through the volume.

Source: Hirschmueller 2008, TPAMI 30(2).
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.lanes import (
    WORDS,
    aligned_words,
    least_lane,
    lesser,
    load_words,
    push,
    read,
    splat_words,
    store_words,
)

WALL = 40_000  # Cost outside the searched range: above any real cost, far from overflow.
LANES = WORDS.count
_u16 = np.uint16


class Downward(NamedTuple):
    """State of the three downward paths: their costs along the last row."""

    # (3, w, search + LANES): down to the right, straight, down to the left. The last LANES are
    # walls. A diagonal path keeps its place in memory, so its first column moves from row to row.
    costs: NDArray[np.uint16]
    floors: NDArray[np.uint16]  # (3, w) least cost of each path.


def start_downward(w: int, search: int) -> Downward:
    """Return paths that start with zero cost."""
    costs = aligned_words(3, w, search + LANES)
    costs[:, :, :search], costs[:, :, search:] = 0, WALL
    return Downward(costs.reshape(-1), np.zeros(3 * w, np.uint16))


@nb.njit(nogil=True, cache=True)
def sweep_sideways(cost, total, w, search, p1, p2):  # pragma: no cover - compiled
    """Fill `total` (rows, w, search) with the summed costs of the two horizontal paths.

    All rows advance by one pixel in turn, because a path waits for the least cost of its last
    pixel. Both arrays are flat.
    """
    rows, span = len(cost) // (w * search), search + 2 * LANES
    state = np.empty(2 * rows * span, np.uint16)
    floors = np.empty(rows, np.uint16)
    small, large = splat_words(p1), splat_words(p2)
    for leftward in range(2):
        state[:] = _u16(WALL)
        floors[:] = _u16(0)
        for row in range(rows):
            first = 2 * row * span + LANES
            state[first : first + search] = _u16(0)
        for i in range(w):
            x = w - 1 - i if leftward else i
            for row in range(rows):
                cell = (row * w + x) * search
                source = (2 * row + (i & 1)) * span + LANES
                target = (2 * row + 1 - (i & 1)) * span + LANES
                floor = splat_words(read(floors, row))
                jump = floor + large
                least = splat_words(_u16(65535))
                for d in range(0, search, LANES):
                    sides = lesser(
                        load_words(state, source + d - 1), load_words(state, source + d + 1)
                    )
                    best = lesser(lesser(sides + small, load_words(state, source + d)), jump)
                    value = best - floor + load_words(cost, cell + d)
                    store_words(state, target + d, value)
                    least = lesser(least, value)
                    if leftward:
                        value = value + load_words(total, cell + d)
                    store_words(total, cell + d, value)
                floors[row] = least_lane(least)


@nb.njit(nogil=True, cache=True)
def enter_downward(costs, floors, y, w, search):  # pragma: no cover - compiled
    """Start the diagonal paths that enter row y at its sides, with zero cost."""
    span = search + LANES
    for place in (-y % w, 2 * w + (y - 1) % w):
        costs[place * span : place * span + search] = _u16(0)
        floors[place] = _u16(0)


@nb.njit(inline="always")
def _advance(before, after, here, jump, floor, small, cost):  # pragma: no cover - compiled
    """Advance a path; `before` and `after` are its costs at the next lower and higher disparity."""
    return lesser(lesser(lesser(before, after) + small, here), jump) - floor + cost


@nb.njit(nogil=True, cache=True)
def sweep_down(
    cost, total, costs, floors, y, columns, at, w, search, p1, p2, out, out_span
):  # pragma: no cover - compiled
    """Advance the three downward paths along a run of columns in row y.

    Args:
        cost, total: flat; the costs of the run start at index `at` of both. `total` holds the
            summed costs of the horizontal paths.
        costs, floors: `Downward`.
        columns: first and last column + 1 of the run.
        out: filled with the summed costs of all five paths, `out_span` apart from LANES on.
    """
    span = search + LANES
    small, large = splat_words(p1), splat_words(p2)
    start, stop = columns
    right, straight, left = (start - y) % w, w + start, 2 * w + (start + y) % w
    for x in range(start, stop):
        cell, sum_at = at + (x - start) * search, LANES + (x - start) * out_span
        floor_a, floor_b = splat_words(read(floors, right)), splat_words(read(floors, straight))
        floor_c = splat_words(read(floors, left))
        jump_a, jump_b, jump_c = floor_a + large, floor_b + large, floor_c + large
        least_a = least_b = least_c = splat_words(_u16(65535))
        last_a = last_b = last_c = splat_words(_u16(WALL))
        a, b, c = right * span, straight * span, left * span
        for d in range(0, search, LANES):
            new = load_words(cost, cell + d)
            here, after = load_words(costs, a + d), load_words(costs, a + d + 1)
            value = _advance(push(last_a, here), after, here, jump_a, floor_a, small, new)
            last_a, least_a = here, lesser(least_a, value)
            store_words(costs, a + d, value)
            summed = load_words(total, cell + d) + value
            here, after = load_words(costs, b + d), load_words(costs, b + d + 1)
            value = _advance(push(last_b, here), after, here, jump_b, floor_b, small, new)
            last_b, least_b = here, lesser(least_b, value)
            store_words(costs, b + d, value)
            summed = summed + value
            here, after = load_words(costs, c + d), load_words(costs, c + d + 1)
            value = _advance(push(last_c, here), after, here, jump_c, floor_c, small, new)
            last_c, least_c = here, lesser(least_c, value)
            store_words(costs, c + d, value)
            store_words(out, sum_at + d, summed + value)
        floors[right] = least_lane(least_a)
        floors[straight] = least_lane(least_b)
        floors[left] = least_lane(least_c)
        right, straight, left = right + 1, straight + 1, left + 1
        right, left = 0 if right == w else right, 2 * w if left == 3 * w else left
