"""Selection of scenes with equal contents, and of test rooms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.scenes.selection import (
    refuse_swapped_pairs,
    split_complete,
    split_test_rooms,
)
from starling.patterns.errors import InputError

BOTH, PAIRS, DEPTH = (1, 1), (1, 0), (0, 1)


def scene(contents: tuple[int, int]) -> Any:
    image, maps = np.zeros((1, 2, 2), np.uint8), np.zeros((1, 2, 2), np.float32)
    pair = StereoObservation(left=image, right=image, ours_px=maps)
    depth = DepthObservation(device_px=maps)
    real = {BOTH: pair.with_depth(maps), PAIRS: pair, DEPTH: depth}[contents]
    return SimpleNamespace(real=real, contents=contents)


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


def test_three_of_eight_rooms_are_held_out_and_none_of_three():
    def split(count: int) -> tuple[int, int]:
        scene_models: Any = [SimpleNamespace(room=str(number)) for number in range(count)]
        training, held_out = split_test_rooms(scene_models)
        assert not {scene.room for scene in training} & {scene.room for scene in held_out}
        return len(training), len(held_out)

    sizes = {3: 0, 4: 1, 7: 1, 8: 3, 12: 3, 16: 4}
    assert {count: split(count)[1] for count in sizes} == sizes
    assert all(sum(split(count)) == count for count in sizes)


def test_swapped_pairs_are_refused():
    image = np.random.default_rng(1).integers(0, 255, (1, 120, 160)).astype(np.uint8)
    moved = np.roll(image, -9, axis=2)
    maps = np.zeros(image.shape, np.float32)

    def captured(left: Any, right: Any) -> Any:
        real = StereoObservation(left=left, right=right, ours_px=maps)
        return SimpleNamespace(name="attic", real=real)

    refuse_swapped_pairs([captured(image, moved), scene(DEPTH)])
    with pytest.raises(InputError, match="images of scene attic must not be swapped"):
        refuse_swapped_pairs([captured(moved, image)])
    with pytest.raises(InputError, match="images of scene attic must be two views"):
        refuse_swapped_pairs([captured(image, image)])
