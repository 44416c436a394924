"""Bootstrap over rooms, and held-out test rooms."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.scenes import rooms

ROOMS = ["hall", "attic", "hall", "porch"]


def test_a_room_mean_ignores_unknown_values():
    values = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, 5.0], [np.nan, 7.0]])
    means = rooms.room_means(values, ROOMS)
    np.testing.assert_array_equal(means, [[2.0, 5.0], [2.0, np.nan], [np.nan, 7.0]])


def test_scenes_of_one_room_are_drawn_together_and_the_number_of_rooms_is_kept():
    times = rooms.resample_rooms(ROOMS, 500, np.random.default_rng(0))
    np.testing.assert_array_equal(times[:, 0], times[:, 2])
    assert (times[:, [0, 1, 3]].sum(axis=1) == 3).all()
    assert np.allclose(times.mean(axis=0), 1, atol=0.15)


def test_intervals_of_few_rooms_have_their_nominal_coverage():
    rng = np.random.default_rng(0)
    for count in (3, 4, 8):
        names = [str(number) for number in range(count)]
        values = rng.standard_normal((400, count))
        times = rooms.resample_rooms(names, 500, rng)
        resampled = times @ values.T / count
        low, high = rooms.interval(resampled, values.mean(axis=1), count)
        covered = np.mean((low <= 0) & (high >= 0))
        assert 0.91 < covered < 0.985
        narrow = np.quantile(resampled, (0.025, 0.975), axis=0)
        assert (high - low > np.diff(narrow, axis=0)[0]).all()


def test_two_rooms_have_no_interval():
    resampled = np.zeros((9, 2))
    low, high = rooms.interval(resampled, np.zeros(2), np.array([2, 3]))
    assert np.isnan(low[0]) and np.isnan(high[0]) and low[1] == high[1] == 0
