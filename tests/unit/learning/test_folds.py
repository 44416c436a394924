"""Training rooms of a held-out room."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.commands import evaluate_captures
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
def test_training_rooms_are_the_next_ones_in_cyclic_order(held, count, expected):
    assert evaluate_captures.choose_training_rooms(ROOMS, held, count) == expected


@given(number=st.integers(2, 12), data=st.data())
def test_each_room_is_used_equally_often_and_never_when_held_out(number, data):
    rooms = [f"room {n}" for n in range(number)]
    count = data.draw(st.integers(1, number - 1))
    taken = {held: evaluate_captures.choose_training_rooms(rooms, held, count) for held in rooms}
    for held, others in taken.items():
        assert held not in others
        assert len(set(others)) == len(others) == count
    for room in rooms:
        assert sum(room in others for others in taken.values()) == count
    assert set(evaluate_captures.choose_training_rooms(rooms, rooms[0])) == set(rooms[1:])


@pytest.mark.parametrize(
    ("rooms", "held", "count", "line"),
    [
        (ROOMS, "e", None, "held-out room must be a known name; got 'e'. Known: "),
        (("a",), "a", None, "rooms must be at least 2; got 1. Take captures of more rooms."),
        (ROOMS, "a", 4, "rooms to learn from must be in [1, 3]; got 4. Choose a value inside."),
        (ROOMS, "a", 0, "rooms to learn from must be in [1, 3]; got 0. Choose a value inside."),
    ],
)
def test_impossible_folds_are_refused(rooms, held, count, line):
    with pytest.raises(InputError) as caught:
        evaluate_captures.choose_training_rooms(rooms, held, count)
    assert str(caught.value).startswith(line)
