"""How ambient light varies over a room, told by dots of an image of it that is simulated."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.captured import captured_scene
from starling.sim.scene.captured.room_light import Lit
from starling.sim.scene.scene import Scene
from tests.unit.sim import test_room_light as rooms
from tests.unit.sim.test_room_light import BELIEVED, DARK, SENSOR, SHAPE

BRIGHTER = 4.0  # From the image's left border to its right one.


def unevenly() -> np.ndarray:
    """Light that rises to the right, and a third of it on the block."""
    rising = np.geomspace(BRIGHTER**-0.5, BRIGHTER**0.5, SHAPE[1], dtype=np.float32)
    share = np.tile(rising, (SHAPE[0], 1))
    share[90:200, 60:150] /= 3
    return share


def scene(share: np.ndarray | None, folder) -> Scene:
    known = rooms.room(folder, 1.0)
    return captured_scene.surface(known, Lit(np.full(SHAPE, 0.5, np.float32), 1.0, share))


def test_dots_tell_where_it_is_brighter(tmp_path):
    """To 15 % in the middle pixel, where half as much as the mean and twice as much is thrown."""
    ambient = 0.4
    known = rooms.room(tmp_path / "set", ambient, share=unevenly())
    found = captured_scene.lit(known, SENSOR, smoothing_px=6.0, within_surfaces=True)
    assert found.ambient_share is not None
    there = found.ambient_share * found.ambient_w_m2 / (ambient * unevenly())
    assert np.median(np.abs(there / np.median(there) - 1)) < 0.15
    assert np.median(there) == pytest.approx(1, rel=0.15)
    off = (found.reflectance / rooms.painted())[20:-20, 20:-20]
    assert np.median(np.abs(off / np.median(off) - 1)) < 0.1


@pytest.mark.parametrize("ambient", [0.17, 0.7])
def test_even_light_is_found_even(ambient, tmp_path):
    """Near and far: what is lost of dots on the way would pass for light where most are thrown."""
    known = rooms.room(tmp_path / "set", ambient)
    found = captured_scene.lit(known, SENSOR, smoothing_px=6.0, within_surfaces=True)
    assert found.ambient_share is not None
    assert np.quantile(np.abs(found.ambient_share - 1), 0.8) < 0.08
    block, wall = found.ambient_share[100:190, 70:140], found.ambient_share[20:70]
    assert np.median(block) / np.median(wall) == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize("believed", [BELIEVED, DARK])
def test_dots_of_another_place_tell_nothing(believed, tmp_path):
    known = rooms.room(tmp_path / "set", 0.4, share=unevenly())
    assert captured_scene.lit(known, believed, smoothing_px=6.0).ambient_share is None


def test_light_is_what_its_share_says_in_both_views(tmp_path):
    """Of what surfaces return of ambient light, and of nothing else."""
    even, shared = (
        direct.layers(Stage(scene(share, tmp_path / str(share is None))), SENSOR)
        for share in (None, unevenly())
    )
    inner = (slice(20, 80), slice(20, -20))  # Above the block: the wall alone.
    there = (shared.left.ambient / even.left.ambient)[inner]
    assert_allclose(there, unevenly()[inner], rtol=0.02)
    assert shared.right is not None and even.right is not None
    assert np.array_equal(shared.left.projector_direct, even.left.projector_direct)
    assert np.array_equal(shared.right.projector_direct, even.right.projector_direct)
    beside = (shared.right.ambient / even.right.ambient)[inner]
    disparity_px = SENSOR.fx_px * SENSOR.baseline_m / rooms.truth_m()[0]
    column = np.arange(SHAPE[1]) - disparity_px
    expected = np.interp(np.arange(SHAPE[1]), column, unevenly()[0])[inner[1]]
    seen = slice(0, int(column[-21]) - 20)
    assert_allclose(beside[:, seen], np.tile(expected[seen], (60, 1)), rtol=0.02)
