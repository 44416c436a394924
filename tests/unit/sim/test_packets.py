"""Rays of an image, traced in packets and once for each pixel's centre."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import starling
from starling.sim.render import backend, direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import cameras, pixels
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material

SIZE = ("width=160", "height=120", "fx_px=100", "fy_px=100", "cx_px=79.5", "cy_px=59.5")
SENSOR = starling.load_sensor("d435", edits=SIZE)


@pytest.fixture(scope="module")
def stage() -> MitsubaScene:
    return MitsubaScene(starling.load_scene("room", SENSOR))


def test_packets_give_the_bits_of_single_rays(stage):
    if not backend.is_jit():
        pytest.skip("the scalar variant has no packets")
    mi, dr = backend.mitsuba(), backend.drjit()
    camera, _ = cameras(SENSOR, stage.scene.world_from_left)
    for shift in (0.0, 0.25):
        ray = camera.ray(pixels(camera.size) + mi.Vector2f(shift, shift))
        first, second = stage.seen(ray), stage.mitsuba.ray_intersect(ray)
        dr.eval(first, second)
        for name in ("t", "p", "n", "uv"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_draft_has_the_truth_of_full_quality(stage):
    full, draft = (direct.layers(stage, SENSOR, subpixels=n).truth for n in (2, 1))
    for name in ("depth_m", "normal", "material", "right_sees", "lit"):
        np.testing.assert_array_equal(getattr(draft, name), getattr(full, name))


def test_draft_has_the_light_of_centre_rays_traced_through_mirrors(stage):
    """A mirror behind the camera changes nothing, but rays are then followed one by one."""
    sheet = solids.plane(0.1, 0.1)
    behind = np.array(stage.scene.world_from_left)
    behind[:3, 3] -= 0.05 * behind[:3, 2]
    mirror = solids.body("mirror", sheet, Material(name="silver", kind="mirror"), behind)
    bodies = *stage.scene.bodies, mirror
    followed = MitsubaScene(dataclasses.replace(stage.scene, bodies=bodies))
    once, again = (direct.layers(scene, SENSOR, subpixels=1).left for scene in (stage, followed))
    for name in ("projector_direct", "ambient"):
        first, second = getattr(once, name), getattr(again, name)
        assert np.isclose(first, second, rtol=1e-4, atol=1e-7).mean() > 0.999
