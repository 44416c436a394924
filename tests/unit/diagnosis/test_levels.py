"""Level of captures over that of the base."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.where.levels import level_ratios

SHAPE = (60, 80)
BLACK_DN = 16.0
LEVELS = np.random.default_rng(0).uniform(20, 90, SHAPE)  # Above black.


def observation(factor: float, *, black_dn: float = BLACK_DN, levels: Any = LEVELS) -> Any:
    images = np.clip(np.rint(black_dn + factor * levels), 0, 255).astype(np.uint8)[None]
    return StereoObservation(left=images, right=images, ours_px=np.ones((1, *SHAPE), np.float32))


def scene(real: Any, *, room: str = "hall", counted: int = LEVELS.size) -> Any:
    mask = np.arange(LEVELS.size).reshape(SHAPE) < counted
    imager = SimpleNamespace(bit_depth=8, black_level_dn=BLACK_DN)
    return SimpleNamespace(
        room=room,
        real=real,
        sensor=SimpleNamespace(left=imager),
        strata=SimpleNamespace(counted=mask),
    )


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_factor_of_exposure_is_the_ratio(factor: float):
    ratios = level_ratios([scene(observation(factor))], [observation(1.0)])
    assert ratios == {"hall": pytest.approx(factor, rel=0.01)}


def test_saturated_pixels_do_not_count():
    """A factor of 4 saturates most pixels."""
    ratios = level_ratios([scene(observation(4.0))], [observation(1.0)])
    assert ratios["hall"] == pytest.approx(4, rel=0.01)


def test_dark_pixels_do_not_count():
    dark = np.where(np.arange(SHAPE[1]) < 60, 1.0, LEVELS)
    captured = observation(2.0, levels=np.where(dark == 1.0, 50.0, dark))
    ratios = level_ratios([scene(captured)], [observation(1.0, levels=dark)])
    assert ratios["hall"] == pytest.approx(2, rel=0.01)


def test_a_room_has_the_median_of_its_scenes():
    factors = (1.0, 1.5, 2.0)
    scenes = [scene(observation(factor)) for factor in factors]
    scenes.append(scene(observation(3.0), room="attic"))
    ratios = level_ratios(scenes, [observation(1.0)] * 4)
    assert ratios == pytest.approx({"hall": 1.5, "attic": 3.0}, rel=0.01)


@pytest.mark.parametrize("counted, rooms", [(99, []), (100, ["hall"])])
def test_scenes_with_few_pixels_are_left_out(counted: int, rooms: list[str]):
    ratios = level_ratios([scene(observation(2.0), counted=counted)], [observation(1.0)])
    assert list(ratios) == rooms


def test_scenes_without_infrared_are_left_out():
    depth = DepthObservation(device_px=np.ones((1, *SHAPE), np.float32))
    assert level_ratios([scene(depth)], [observation(1.0)]) == {}
    assert level_ratios([scene(observation(1.0))], [depth]) == {}
