"""Rooms that agree about where a gap is tell in whose frame it stays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.strata import Ground
from starling.diagnosis.where import frames, maps
from starling.diagnosis.where.frames import Stays
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

HEIGHT, WIDTH = DISPARITY.shape
ACROSS, DOWN = np.meshgrid(np.linspace(-0.5, 0.5, WIDTH), np.linspace(-0.4, 0.4, HEIGHT))


def ground(scene: int, *, moved: float) -> Ground:
    """A scene in whose image the projector's field lies somewhere."""
    x, y = moved * np.random.default_rng(scene).uniform(-0.4, 0.4, 2)
    field = np.stack([ACROSS + x, DOWN + y], axis=-1)
    return dataclasses.replace(GROUND, projector=field.astype(np.float32))


def reading(seed: int, off_px: np.ndarray | float) -> Reading:
    noise = 0.05 * np.random.default_rng(seed).standard_normal(DISPARITY.shape)
    disparity = (DISPARITY + noise + off_px).astype(np.float32)
    return Reading(left=None, right=None, ours_px=disparity[None], device_px=None)


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(20 * x) * np.cos(15 * y)


def drawn(stays: Stays | None, *, rooms: int = 5, moved: float = 1.0) -> list[maps.Map]:
    grounds = [ground(scene, moved=moved) for scene in range(rooms)]
    off: list[np.ndarray | float] = [0.0] * rooms
    if stays == "camera":
        off = [waves(ACROSS, DOWN)] * rooms
    elif stays == "projector":
        off = [waves(one.projector[..., 0], one.projector[..., 1]) for one in grounds]
    base = [reading(scene, 0.0) for scene in range(rooms)]
    real = [reading(100 + scene, one + 0.3) for scene, one in enumerate(off)]
    return maps.maps(base, real, grounds, [f"room {scene}" for scene in range(rooms)])


@pytest.mark.parametrize("stays", ["camera", "projector", None])
def test_what_stays_is_told_in_its_frame(stays: Stays | None):
    """What is off all over tells nothing. The projector's cells leave 0.69 of the waves."""
    found = drawn(stays)
    assert frames.frame(found, "error") == frames.of_arm(found, "depth") == stays
    assert frames.of_arm(found, "image") is None  # No infrared.
    named = {one.frame: one.agreement for one in found if one.quantity == "error"}
    if stays is not None:
        other = maps.PROJECTOR if stays == "camera" else maps.CAMERA
        assert named[stays].min() > 0.6 * np.var(waves(ACROSS, DOWN)) > 2 * named[other].mean()


def test_where_both_frames_are_one_either_may_hold_it():
    assert frames.frame(drawn("camera", moved=0.0), "error") == "both"


@pytest.mark.parametrize("rooms", [3, 5, 8])
def test_chance_is_rarely_taken_for_a_place(rooms: int):
    """Of rooms that share nothing: 300 draws, of which one in forty is asked for at most."""
    rng = np.random.default_rng(rooms)
    told = 0
    for _ in range(300):
        each = rng.standard_normal((rooms, maps.ROWS, maps.COLUMNS))
        found = [maps._over_rooms("error", frame, each) for frame in (maps.CAMERA, maps.PROJECTOR)]
        told += frames.frame(found, "error") is not None
    assert told <= 15


def test_few_rooms_or_cells_tell_nothing():
    assert frames.frame(drawn("camera", rooms=2), "error") is None
    bare = dataclasses.replace(GROUND, counted=np.zeros_like(GROUND.counted))
    found = maps.maps([reading(0, 0.0)] * 3, [reading(1, 0.0)] * 3, [bare] * 3, ["a", "b", "c"])
    assert all(np.isnan(one.agreement).all() for one in found)
    assert frames.frame(found, "error") is None
