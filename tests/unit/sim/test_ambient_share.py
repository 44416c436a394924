"""Estimation of the variation of ambient light from the dots of a simulated image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import captured_scene
from starling.sim.scene.captured.room_light import RoomLight
from starling.sim.scene.scene import Scene
from tests.unit.sim import test_room_light as rooms
from tests.unit.sim.test_room_light import BELIEVED, DARK, SENSOR, SHAPE

BRIGHTER = 4.0  # From the left to the right border of the image.


def unevenly() -> np.ndarray:
    """Light that increases to the right, and is a third on the block."""
    rising = np.geomspace(BRIGHTER**-0.5, BRIGHTER**0.5, SHAPE[1], dtype=np.float32)
    share = np.tile(rising, (SHAPE[0], 1))
    share[90:200, 60:150] /= 3
    return share


def scene(share: np.ndarray | None, folder) -> Scene:
    known = rooms.room(folder, 1.0)
    return captured_scene.scene_from_light(
        known, RoomLight(np.full(SHAPE, 0.5, np.float32), 1.0, share)
    )


def test_dots_give_the_variation_of_ambient_light(tmp_path):
    """The median error is at most 15 %, for light between half and twice the mean."""
    ambient = 0.4
    known = rooms.room(tmp_path / "set", ambient, share=unevenly())
    estimated = captured_scene.estimate_light(known, SENSOR, smoothing_px=6.0, within_surfaces=True)
    assert estimated.ambient_share is not None
    ratio = estimated.ambient_share * estimated.ambient_w_m2 / (ambient * unevenly())
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.15
    assert np.median(ratio) == pytest.approx(1, rel=0.15)
    off = (estimated.reflectance / rooms.painted())[20:-20, 20:-20]
    assert np.median(np.abs(off / np.median(off) - 1)) < 0.1


@pytest.mark.parametrize("ambient", [0.17, 0.7])
def test_even_light_is_estimated_as_even(ambient, tmp_path):
    """Blur of the dots is not mistaken for ambient light, near and far."""
    known = rooms.room(tmp_path / "set", ambient)
    estimated = captured_scene.estimate_light(known, SENSOR, smoothing_px=6.0, within_surfaces=True)
    assert estimated.ambient_share is not None
    assert np.quantile(np.abs(estimated.ambient_share - 1), 0.8) < 0.08
    block, wall = estimated.ambient_share[100:190, 70:140], estimated.ambient_share[20:70]
    assert np.median(block) / np.median(wall) == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize("believed", [BELIEVED, DARK])
def test_other_dots_give_no_ambient_share(believed, tmp_path):
    known = rooms.room(tmp_path / "set", 0.4, share=unevenly())
    assert captured_scene.estimate_light(known, believed, smoothing_px=6.0).ambient_share is None


def test_ambient_share_scales_ambient_light_in_both_views(tmp_path):
    """The share scales ambient light, and nothing else."""
    even, shared = (
        direct.layers(MitsubaScene(scene(share, tmp_path / str(share is None))), SENSOR)
        for share in (None, unevenly())
    )
    inner = (slice(20, 80), slice(20, -20))  # The wall above the block.
    ratio = (shared.left.ambient / even.left.ambient)[inner]
    assert_allclose(ratio, unevenly()[inner], rtol=0.02)
    assert shared.right is not None and even.right is not None
    assert np.array_equal(shared.left.projector_direct, even.left.projector_direct)
    assert np.array_equal(shared.right.projector_direct, even.right.projector_direct)
    right_ratio = (shared.right.ambient / even.right.ambient)[inner]
    disparity_px = SENSOR.fx_px * SENSOR.baseline_m / rooms.truth_m()[0]
    column = np.arange(SHAPE[1]) - disparity_px
    expected = np.interp(np.arange(SHAPE[1]), column, unevenly()[0])[inner[1]]
    seen = slice(0, int(column[-21]) - 20)
    assert_allclose(right_ratio[:, seen], np.tile(expected[seen], (60, 1)), rtol=0.02)
