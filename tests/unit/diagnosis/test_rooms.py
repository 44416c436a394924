"""Rooms as the units of evidence."""

from __future__ import annotations

import numpy as np

from diagnosis import rooms

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
