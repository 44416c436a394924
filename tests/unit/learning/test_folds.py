"""Which rooms are learnt from while one is held out."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.data import folds
from starling.patterns.errors import InputError

ROOMS = ("a", "b", "c", "d")


@pytest.mark.parametrize(
    ("held", "count", "expected"),
    [
        ("a", None, ("b", "c", "d")),
        ("c", None, ("d", "a", "b")),
        ("d", 2, ("a", "b")),
        ("b", 1, ("c",)),
        ("b", 3, ("c", "d", "a")),
    ],
)
def test_the_next_rooms_in_order_round_and_round(held, count, expected):
    assert folds.learnt_from(ROOMS, held, count) == expected


@given(number=st.integers(2, 12), data=st.data())
def test_each_room_is_learnt_from_as_often_as_any_and_never_while_it_is_held(number, data):
    rooms = [f"room {n}" for n in range(number)]
    count = data.draw(st.integers(1, number - 1))
    taken = {held: folds.learnt_from(rooms, held, count) for held in rooms}
    for held, others in taken.items():
        assert held not in others
        assert len(set(others)) == len(others) == count
    for room in rooms:
        assert sum(room in others for others in taken.values()) == count
    assert set(folds.learnt_from(rooms, rooms[0])) == set(rooms[1:])


@pytest.mark.parametrize(
    ("rooms", "held", "count", "line"),
    [
        (ROOMS, "e", None, "held-out room must be a known name; got 'e'. Known: "),
        (("a",), "a", None, "rooms must be at least 2; got 1. Take captures of more rooms."),
        (ROOMS, "a", 4, "rooms to learn from must be in [1, 3]; got 4. Choose a value inside."),
        (ROOMS, "a", 0, "rooms to learn from must be in [1, 3]; got 0. Choose a value inside."),
    ],
)
def test_what_cannot_be_held_out_is_refused(rooms, held, count, line):
    with pytest.raises(InputError) as caught:
        folds.learnt_from(rooms, held, count)
    assert str(caught.value).startswith(line)
