"""Intervals of differences: they cover, they pair, and rooms are what is drawn."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.evaluation.figures.bootstrap import paired_difference, paired_share
from starling.patterns.errors import InputError

ROOMS = [f"room {number}" for number in range(10)]


def test_what_both_methods_share_cancels():
    shared = np.linspace(0.5, 0.99, 10)
    found = paired_difference(list(shared + 0.01), list(shared), ROOMS, seed=0)
    assert found.mean == pytest.approx(0.01)
    assert found.low == pytest.approx(0.01)
    assert found.high == pytest.approx(0.01)
    assert found.excludes_zero
    assert (found.rooms, found.above) == (10, 10)


def test_scenes_of_one_room_are_one_piece_of_evidence():
    alone = paired_difference([0.25, -0.25], [0.0, 0.0], ["a", "b"], seed=0)
    repeated = paired_difference([0.25] * 64 + [-0.25], [0.0] * 65, ["a"] * 64 + ["b"], seed=0)
    assert repeated == alone
    assert not alone.excludes_zero


def test_equal_seeds_give_equal_intervals():
    rng = np.random.default_rng(0)
    first, second = rng.random(10).tolist(), rng.random(10).tolist()
    once = paired_difference(first, second, ROOMS, seed=3)
    assert once == paired_difference(first, second, ROOMS, seed=3)
    assert once != paired_difference(first, second, ROOMS, seed=4)
    swapped = paired_difference(second, first, ROOMS, seed=3)
    assert swapped.mean == -once.mean


def test_interval_of_ten_normal_rooms_covers_as_it_says():
    """95 % wanted; 400 trials tell it to +- 1.1 %. A plain percentile interval covers 90 %.

    Normal differences only: it says nothing of heavy tails, nor of rooms unlike those drawn.
    """
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(400):
        found = paired_difference(rng.normal(0.02, 0.03, 10).tolist(), [0.0] * 10, ROOMS, seed=1)
        covered += found.low <= 0.02 <= found.high
    assert 0.925 <= covered / 400 <= 0.975


def test_how_hard_rooms_are_cancels_in_a_share():
    """Two fifths less in every room, whatever its error: no spread at all."""
    hard = np.geomspace(0.01, 2.0, 10)
    found = paired_share(hard.tolist(), (0.6 * hard).tolist(), ROOMS, seed=0)
    assert (found.share, found.low, found.high) == pytest.approx((0.4, 0.4, 0.4))
    assert (found.rooms, found.less) == (10, 10)
    none = paired_share(hard.tolist(), hard.tolist(), ROOMS, seed=0)
    assert none.share == 0 and none.less == 0


def test_the_interval_of_a_share_covers_as_it_says():
    """95 % wanted of ten rooms whose errors and shares both scatter; 400 trials tell +- 1.1 %."""
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(400):
        hard = rng.gamma(4.0, 0.05, 10)
        own = hard * rng.normal(0.6, 0.1, 10)
        found = paired_share(hard.tolist(), own.tolist(), ROOMS, seed=1)
        covered += found.low <= 0.4 <= found.high
    assert 0.92 <= covered / 400 <= 0.98


def test_a_share_of_nothing_is_refused():
    with pytest.raises(InputError, match="first must be > 0 in every room; got 0"):
        paired_share([0.0, 1.0], [0.0, 1.0], ["a", "b"], seed=0)


@pytest.mark.parametrize(
    ("first", "second", "room", "message"),
    [
        ([1.0], [1.0, 2.0], ["a", "b"], "first, second and room must be equally long"),
        ([1.0, np.nan], [1.0, 2.0], ["a", "b"], "figures must be finite; got 1"),
        ([1.0, 2.0], [1.0, 2.0], ["a", "a"], "rooms must be at least 2; got 1"),
    ],
)
def test_what_has_no_spread_is_refused(first, second, room, message):
    with pytest.raises(InputError, match=message):
        paired_difference(first, second, room, seed=0)
