"""Sun and a second projector: strength, shadows, and linearity."""

import dataclasses

import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material, Scene, Sun
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Projector

WHITE = Material(name="white", reflectance=0.6)


def small(**changes):
    base = dataclasses.replace(presets.load("d435"), width=160, height=120, cx_px=79.5, cy_px=59.5)
    return dataclasses.replace(base, fx_px=200.0, fy_px=200.0, **changes)


def plate(name, distance_m, *, size_m=8.0, x_m=0.0):
    sheet = solids.plane(size_m, size_m)
    return solids.body(name, sheet, WHITE, frames.pose((x_m, 0, distance_m)))


def rendered(*bodies, sensor=None, subpixels=2, **changes):
    scene = Scene(name="test", bodies=bodies, **changes)
    return direct.layers(mitsuba_scene.MitsubaScene(scene), sensor or small(), subpixels=subpixels)


def middle(image):
    return float(image[55:65, 75:85].mean())


@pytest.mark.parametrize("towards", [(0, 0, -1), (0, -1, -1), (3.0, 0.5, -1.0)])
def test_sunlit_wall(towards):
    """The radiance is rho / pi E cos(theta); the sun is a point, without soft shadows."""
    seen = rendered(plate("wall", 1.0), sun=Sun(irradiance_w_m2=40.0, towards=towards)).left
    cosine = -towards[2] / np.linalg.norm(towards)
    assert middle(seen.other) == pytest.approx(WHITE.reflectance / np.pi * 40 * cosine, rel=1e-4)


def test_sun_shadow_follows_geometry():
    """A plate 0.1 m before the wall under sun at 45 degrees casts its shadow 0.1 m aside."""
    small_plate = plate("plate", 0.9, size_m=0.1, x_m=0.2)
    sun = Sun(irradiance_w_m2=10.0, towards=(1.0, 0.0, -1.0))
    sensor = small()
    seen = rendered(plate("wall", 1.0), small_plate, sensor=sensor, sun=sun, subpixels=8).left.other
    row = seen[60] / np.float32(WHITE.reflectance / np.pi * 10 / 2**0.5)
    dark = 1 - row[: round(sensor.cx_px + 200 * 0.16)]
    assert dark.sum() == pytest.approx(200 * 0.1, abs=0.1)  # Its width [px].
    middle_px = (dark * np.arange(len(dark))).sum() / dark.sum()
    assert middle_px == pytest.approx(sensor.cx_px + 200 * 0.1, abs=0.1)


def device(power_w, **changes):
    return Projector(power_w=power_w, pattern="d415", fov_x_deg=70.0, fov_y_deg=55.0, **changes)


def test_second_projector_equals_the_own_layer():
    """At the same place, a second projector equals the camera's own layer times its power."""
    part = device(0.5, position_m=(0.1, 0.02, 0.0), rotation_deg=(0.0, 5.0, 0.0))
    sensor = small(projector=part)
    view = rendered(plate("wall", 1.0), sensor=sensor, other_projector=part).left
    np.testing.assert_allclose(view.other, 0.5 * view.projector_direct, rtol=1e-5)
    assert view.other.max() > 0


def test_second_projector_is_a_surface_texture():
    """Both imagers see its dots on the same surface points, as a texture.

    The exposure times of two devices are not modelled.
    """
    sensor = small(baseline_m=0.05)  # 10 px of disparity at 1 m.
    part = device(1.0, position_m=(-0.2, 0.0, 0.0))
    layers = rendered(plate("wall", 1.0), sensor=sensor, other_projector=part)
    left, right = layers.left.other[:, 10:], layers.right.other[:, :-10]
    np.testing.assert_allclose(left, right, atol=1e-3 * left.max())
    assert left.std() > 0.2 * left.mean()


def test_other_lights_add_up():
    sun, part = Sun(irradiance_w_m2=2.0), device(0.3, position_m=(0.2, 0.0, 0.0))
    wall = plate("wall", 1.0)
    alone = rendered(wall, sun=sun).left.other + rendered(wall, other_projector=part).left.other
    double = dataclasses.replace(part, power_w=0.6)
    both = rendered(wall, sun=sun, other_projector=part).left
    np.testing.assert_allclose(both.other, alone, rtol=1e-5)
    np.testing.assert_allclose(
        rendered(wall, other_projector=double).left.other,
        2 * rendered(wall, other_projector=part).left.other,
        rtol=1e-5,
    )
    bare = rendered(wall).left
    assert np.array_equal(both.projector_direct, bare.projector_direct)
    assert not bare.other.any()


def test_second_projector_with_structured_light():
    """It works at any position, though the camera's own projector replaces the right imager."""
    kinect = dataclasses.replace(
        presets.load("kinect-v1"),
        width=160,
        height=120,
        fx_px=150.0,
        fy_px=150.0,
        cx_px=80.0,
        cy_px=60.0,
    )
    seen = rendered(plate("wall", 1.0), sensor=kinect, other_projector=device(1.0)).left
    assert seen.other.max() > 0
