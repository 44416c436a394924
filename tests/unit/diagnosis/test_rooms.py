"""Rooms as the units of evidence."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from starling.diagnosis.scenes import rooms
from starling.diagnosis.which import attribution

ROOMS = ["hall", "attic", "hall", "porch"]


def test_a_room_s_mean_is_that_of_what_is_known_of_it():
    values = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, 5.0], [np.nan, 7.0]])
    found = rooms.means(values, ROOMS)
    np.testing.assert_array_equal(found, [[2.0, 5.0], [2.0, np.nan], [np.nan, 7.0]])


def test_scenes_of_one_room_are_drawn_together_and_as_many_rooms_as_there_are():
    times = rooms.draws(ROOMS, 500, np.random.default_rng(0))
    np.testing.assert_array_equal(times[:, 0], times[:, 2])
    assert (times[:, [0, 1, 3]].sum(axis=1) == 3).all()
    assert np.allclose(times.mean(axis=0), 1, atol=0.15)


def test_intervals_of_few_rooms_cover_as_often_as_they_say():
    rng = np.random.default_rng(0)
    for count in (3, 4, 8):
        names = [str(number) for number in range(count)]
        values = rng.standard_normal((400, count))
        times = rooms.draws(names, 500, rng)
        drawn = times @ values.T / count
        low, high = rooms.interval(drawn, values.mean(axis=1), count)
        covered = np.mean((low <= 0) & (high >= 0))
        assert 0.91 < covered < 0.985
        narrow = np.quantile(drawn, (0.025, 0.975), axis=0)
        assert (high - low > np.diff(narrow, axis=0)[0]).all()


def test_of_two_rooms_there_is_no_interval():
    drawn = np.zeros((9, 2))
    low, high = rooms.interval(drawn, np.zeros(2), np.array([2, 3]))
    assert np.isnan(low[0]) and np.isnan(high[0]) and low[1] == high[1] == 0


def test_three_of_eight_rooms_are_locked_and_none_of_three():
    def split(count: int) -> tuple[int, int]:
        subjects: Any = [SimpleNamespace(room=str(number)) for number in range(count)]
        asked, locked = attribution.parted(subjects)
        assert not {one.room for one in asked} & {one.room for one in locked}
        return len(asked), len(locked)

    sizes = {3: 0, 4: 1, 7: 1, 8: 3, 12: 3, 16: 4}
    assert {count: split(count)[1] for count in sizes} == sizes
    assert all(sum(split(count)) == count for count in sizes)
