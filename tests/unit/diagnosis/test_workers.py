"""How scenes are partitioned among processes."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.workers import partition


@pytest.mark.parametrize(
    ("scenes", "held_out", "count", "expected"),
    [
        ("abcde", "xyz", 2, ["acexz", "bdey"]),  # Both hold the fifth scene.
        ("abcd", "x", 2, ["acx", "bd"]),
        ("ab", "", 5, ["a", "b", "a", "b", "a"]),
        ("a", "x", 1, ["ax"]),
    ],
)
def test_remaining_scenes_are_shared(scenes: str, held_out: str, count: int, expected: list[str]):
    assert ["".join(names) for names in partition(scenes, held_out, count)] == expected


@given(count_training=st.integers(1, 12), count_held_out=st.integers(0, 6), count=st.integers(1, 8))
def test_workers_hold_equally_many_training_scenes(
    count_training: int, count_held_out: int, count: int
):
    scenes = [f"asked {number}" for number in range(count_training)]
    held_out = [f"other {number}" for number in range(count_held_out)]
    held = partition(scenes, held_out, count)
    training = [[name for name in names if name in scenes] for names in held]
    assert len(held) == count and {len(names) for names in training} == {
        -(-count_training // count)
    }
    holders = Counter(name for names in held for name in names)
    assert set(holders) == {*scenes, *held_out}
    assert all(holders[name] == 1 for name in held_out)
