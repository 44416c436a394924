"""How scenes are dealt among processes."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.workers import dealt


@pytest.mark.parametrize(
    ("scenes", "aside", "count", "expected"),
    [
        ("abcde", "xyz", 2, ["acexz", "bdey"]),  # Both hold the fifth.
        ("abcd", "x", 2, ["acx", "bd"]),
        ("ab", "", 5, ["a", "b", "a", "b", "a"]),
        ("a", "x", 1, ["ax"]),
    ],
)
def test_what_is_left_over_is_shared(scenes: str, aside: str, count: int, expected: list[str]):
    assert ["".join(one) for one in dealt(scenes, aside, count)] == expected


@given(asked=st.integers(1, 12), others=st.integers(0, 6), count=st.integers(1, 8))
def test_no_process_is_idle_and_none_holds_more_than_one_beyond_another(
    asked: int, others: int, count: int
):
    scenes = [f"asked {number}" for number in range(asked)]
    aside = [f"other {number}" for number in range(others)]
    held = dealt(scenes, aside, count)
    own = [[name for name in one if name in scenes] for one in held]
    assert len(held) == count and {len(one) for one in own} == {-(-asked // count)}
    holders = Counter(name for one in held for name in one)
    assert set(holders) == {*scenes, *aside}
    assert all(holders[name] == 1 for name in aside)
