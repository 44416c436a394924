"""Detection limits of several sets of scenes."""

from __future__ import annotations

from diagnosis import detection


def test_limits_hold_in_every_set():
    """The farther one of each side, none where one set finds none, and choices that all find."""
    one = {
        "roll": {"base": 0.0, "below": -0.1, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": 0.01},
        "median": {"found": [3, 5]},
    }
    other = {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.1},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }
    assert detection.in_each([one]) == one
    assert detection.in_each([one, other]) == {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }
