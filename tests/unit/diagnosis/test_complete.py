"""Which scenes hold what the most frequent kind holds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.scenes.comparable import complete

BOTH, PAIRS, DEPTH = (1, 1), (1, 0), (0, 1)


def scene(held: tuple[int, int]) -> Any:
    left, device_px = (1 if one else None for one in held)
    return SimpleNamespace(real=SimpleNamespace(left=left, device_px=device_px), held=held)


@pytest.mark.parametrize(
    "held, kept",
    [
        ([BOTH, BOTH, PAIRS], [BOTH, BOTH]),
        ([BOTH, BOTH, DEPTH, PAIRS], [BOTH, BOTH]),
        ([DEPTH, BOTH, DEPTH], [DEPTH, BOTH, DEPTH]),
        ([PAIRS, DEPTH], [PAIRS]),
        ([DEPTH], [DEPTH]),
    ],
)
def test_scenes_that_hold_less_than_the_others_are_left_aside(held, kept):
    asked, aside = complete([scene(one) for one in held])
    assert [one.held for one in asked] == kept
    assert sorted(one.held for one in (*asked, *aside)) == sorted(held)
