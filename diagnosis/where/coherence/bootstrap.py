"""Estimates of the coherence split with intervals by a bootstrap over rooms, and pairs of rooms."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.rooms import FEWEST, interval, resample_rooms
from starling.diagnosis.where.coherence.shares import Estimate

Values = NDArray[np.float64]  # (bands,)
Table = dict[str, Values]  # By quantity.

_DRAWS = 500
_MOST_PAIRS = 60  # Pairs of scenes that are compared.


def estimates(
    pooled: Callable[[NDArray[np.float64]], Table], rooms: Sequence[str]
) -> dict[str, list[Estimate]]:
    """Compute each quantity by band, with its interval over rooms.

    Args:
        pooled: computes the quantities from the weight of each scene.
        rooms: room of each scene.
    """
    values = pooled(np.ones(len(rooms)))
    count = len(set(rooms))
    if count < FEWEST:
        return {name: [(float(each), None, None) for each in row] for name, row in values.items()}
    times = resample_rooms(rooms, _DRAWS, np.random.default_rng(0)).astype(np.float64)
    # A resample of a single room has no pair of rooms.
    drawn = [pooled(weights) for weights in times if _room_count(weights, rooms) > 1]
    result = {}
    for name, row in values.items():
        resampled = np.stack([table[name] for table in drawn])
        resampled = np.where(np.isfinite(resampled).any(axis=0), resampled, 0.0)
        low, high = interval(resampled, row, count)
        result[name] = [
            (float(value), _known(lower), _known(upper))
            for value, lower, upper in zip(row, low, high, strict=True)
        ]
    return result


def quantities(kind: type) -> list[str]:
    """Return the names of the estimates of a result by band."""
    return [each.name for each in fields(kind) if each.name != "band"]


def pairs_of_rooms(rooms: Sequence[str]) -> list[tuple[int, int]]:
    """List pairs of scenes of different rooms; of many pairs a random part."""
    pairs = [
        (first, second)
        for first, second in itertools.combinations(range(len(rooms)), 2)
        if rooms[first] != rooms[second]
    ]
    if len(pairs) <= _MOST_PAIRS:
        return pairs
    chosen = np.random.default_rng(0).choice(len(pairs), _MOST_PAIRS, replace=False)
    return [pairs[number] for number in sorted(chosen)]


def with_total(values: Values) -> Values:
    """Append the sum over bands."""
    return np.append(values, values.sum())


def ratio(values: Values, whole: Values) -> Values:
    """Divide; NaN where the denominator is not positive."""
    return np.where(whole > 0, values / np.where(whole > 0, whole, 1.0), np.nan)


def _room_count(weights: NDArray[np.float64], rooms: Sequence[str]) -> int:
    return len({room for room, weight in zip(rooms, weights, strict=True) if weight})


def _known(end: float) -> float | None:
    return float(end) if np.isfinite(end) else None
