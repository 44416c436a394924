"""Intervals over rooms, and the pairs of rooms that are compared."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.where.coherence import bootstrap


def test_many_rooms_are_compared_in_part() -> None:
    pairs = bootstrap.pairs_of_rooms([f"room {number // 2}" for number in range(40)])
    assert len(pairs) == len(set(pairs)) == 60
    assert all(first < second and first // 2 != second // 2 for first, second in pairs)
    assert bootstrap.pairs_of_rooms(["a", "a", "b"]) == [(0, 2), (1, 2)]
    assert bootstrap.pairs_of_rooms(["a", "a"]) == []


def test_interval_holds_the_mean_of_rooms() -> None:
    values = np.array([0.2, 0.4, 0.3, 0.5])

    def pooled(times: np.ndarray) -> bootstrap.Table:
        return {"share": np.array([times @ values / times.sum(), np.nan])}

    (mean, low, high), unknown = bootstrap.estimates(pooled, ["a", "b", "c", "d"])["share"]
    assert mean == np.mean(values) and low is not None and high is not None
    assert 0 < low < mean < high < 0.7
    assert np.isnan(unknown[0]) and unknown[1:] == (None, None)
    few = bootstrap.estimates(pooled, ["a", "a", "b", "b"])["share"][0]
    assert few == (mean, None, None)


def test_ratio_of_nothing_is_unknown() -> None:
    values = bootstrap.ratio(np.array([1.0, 2.0]), np.array([2.0, 0.0]))
    assert values[0] == 0.5 and np.isnan(values[1])
