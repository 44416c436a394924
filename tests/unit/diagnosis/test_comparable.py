"""Selection of scenes with equal contents."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.scenes.comparable import split_complete

BOTH, PAIRS, DEPTH = (1, 1), (1, 0), (0, 1)


def scene(contents: tuple[int, int]) -> Any:
    left, device_px = (1 if held else None for held in contents)
    return SimpleNamespace(real=SimpleNamespace(left=left, device_px=device_px), contents=contents)


@pytest.mark.parametrize(
    "contents, expected",
    [
        ([BOTH, BOTH, PAIRS], [BOTH, BOTH]),
        ([BOTH, BOTH, DEPTH, PAIRS], [BOTH, BOTH]),
        ([DEPTH, BOTH, DEPTH], [DEPTH, BOTH, DEPTH]),
        ([PAIRS, DEPTH], [PAIRS]),
        ([DEPTH], [DEPTH]),
    ],
)
def test_scenes_that_hold_less_than_most_are_incomplete(contents, expected):
    complete, incomplete = split_complete([scene(held) for held in contents])
    assert [model.contents for model in complete] == expected
    assert sorted(model.contents for model in (*complete, *incomplete)) == sorted(contents)
