"""Rooms that agree on the location of a gap show the frame in which it is fixed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import DepthObservation
from starling.diagnosis.scenes.strata import Strata
from starling.diagnosis.where import frames, maps
from starling.diagnosis.where.frames import FixedFrame
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

HEIGHT, WIDTH = DISPARITY.shape
ACROSS, DOWN = np.meshgrid(np.linspace(-0.5, 0.5, WIDTH), np.linspace(-0.4, 0.4, HEIGHT))


def strata(scene: int, *, moved: float) -> Strata:
    """Return strata of a scene with a random position of the projector field."""
    x, y = moved * np.random.default_rng(scene).uniform(-0.4, 0.4, 2)
    field = np.stack([ACROSS + x, DOWN + y], axis=-1)
    return dataclasses.replace(GROUND, projector=field.astype(np.float32))


def reading(seed: int, off_px: np.ndarray | float) -> DepthObservation:
    noise = 0.05 * np.random.default_rng(seed).standard_normal(DISPARITY.shape)
    disparity = (DISPARITY + noise + off_px).astype(np.float32)
    return DepthObservation(device_px=disparity[None])


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(20 * x) * np.cos(15 * y)


def drawn(fixed: FixedFrame | None, *, rooms: int = 5, moved: float = 1.0) -> list[maps.GapMap]:
    scene_strata = [strata(scene, moved=moved) for scene in range(rooms)]
    off: list[np.ndarray | float] = [0.0] * rooms
    if fixed == "camera":
        off = [waves(ACROSS, DOWN)] * rooms
    elif fixed == "projector":
        off = [waves(each.projector[..., 0], each.projector[..., 1]) for each in scene_strata]
    base = [reading(scene, 0.0) for scene in range(rooms)]
    real = [reading(100 + scene, error + 0.3) for scene, error in enumerate(off)]
    return maps.gap_maps(base, real, scene_strata, [f"room {scene}" for scene in range(rooms)])


@pytest.mark.parametrize("fixed", ["camera", "projector", None])
def test_fixed_gap_is_found_in_its_frame(fixed: FixedFrame | None):
    """A uniform error has no frame. The projector's cells keep 0.69 of the waves' variance."""
    drawn_maps = drawn(fixed)
    assert (
        frames.common_frame(drawn_maps, "error")
        == frames.segment_frame(drawn_maps, "depth")
        == fixed
    )
    assert frames.segment_frame(drawn_maps, "image") is None  # No infrared.
    agreement = {each.frame: each.agreement for each in drawn_maps if each.quantity == "error"}
    if fixed is not None:
        other_frame = maps.PROJECTOR if fixed == "camera" else maps.CAMERA
        assert (
            agreement[fixed].min()
            > 0.6 * np.var(waves(ACROSS, DOWN))
            > 2 * agreement[other_frame].mean()
        )


def test_coinciding_frames_give_both():
    assert frames.common_frame(drawn("camera", moved=0.0), "error") == "both"


@pytest.mark.parametrize("rooms", [3, 5, 8])
def test_noise_rarely_has_a_frame(rooms: int):
    """For unrelated rooms at most one in forty draws may show a frame; 300 are drawn."""
    rng = np.random.default_rng(rooms)
    count = 0
    for _ in range(300):
        each = rng.standard_normal((rooms, maps.ROWS, maps.COLUMNS))
        drawn_maps = [
            maps._over_rooms("error", frame, each) for frame in (maps.CAMERA, maps.PROJECTOR)
        ]
        count += frames.common_frame(drawn_maps, "error") is not None
    assert count <= 15


def test_few_rooms_or_cells_have_no_frame():
    assert frames.common_frame(drawn("camera", rooms=2), "error") is None
    bare = dataclasses.replace(GROUND, counted=np.zeros_like(GROUND.counted))
    drawn_maps = maps.gap_maps(
        [reading(0, 0.0)] * 3, [reading(1, 0.0)] * 3, [bare] * 3, ["a", "b", "c"]
    )
    assert all(np.isnan(each.agreement).all() for each in drawn_maps)
    assert frames.common_frame(drawn_maps, "error") is None
