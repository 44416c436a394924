"""Radiance of a plain wall in closed form.

Rationale: a Lambertian wall lit by a projector without pattern has a closed-form radiance.
Expected: L = rho / pi E cos(theta) with E = P / A / z^2 on a fronto-parallel plane, to 0.5 %.
"""

import dataclasses

import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.render import backend, direct, emission, mitsuba_scene
from starling.sim.scene import materials
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets

REFLECTANCE = 0.6


@pytest.fixture
def even(tmp_path):
    """A D435 whose projector, at the left imager, lights its whole field evenly."""
    import cv2

    path = tmp_path / "even.png"
    cv2.imwrite(str(path), np.full((64, 96), 200, np.uint8))
    sensor = presets.load("d435")
    part = dataclasses.replace(
        sensor.projector,
        pattern=str(path),
        position_m=(0.0, 0.0, 0.0),
        fov_x_deg=100.0,
        fov_y_deg=80.0,
    )
    return dataclasses.replace(sensor, projector=part)


def wall(distance_m: float, *, tilt_deg: float = 0.0):
    sheet = solids.body(
        "wall",
        solids.plane(20 * distance_m, 20 * distance_m),
        Material(name="white", reflectance=REFLECTANCE),
        frames.pose((0, 0, distance_m), (0, tilt_deg, 0)),
    )
    light = Ambient(gradient=0.0)
    return mitsuba_scene.MitsubaScene(Scene(name="wall", bodies=(sheet,), ambient=light))


def centre(image, sensor):
    row, column = round(sensor.cy_px), round(sensor.cx_px)
    return float(image[row - 2 : row + 3, column - 2 : column + 3].mean())


def irradiance_at_one_metre(sensor) -> float:
    half_x, half_y = emission.half_tangents(sensor.projector)
    return 1 / (4 * half_x * half_y)


@pytest.mark.parametrize("distance_m", [0.5, 1.0, 2.0, 4.0])
def test_lambertian_wall_and_inverse_square(even, distance_m):
    seen = direct.layers(wall(distance_m), even).left.projector_direct
    expected = REFLECTANCE / np.pi * irradiance_at_one_metre(even) / distance_m**2
    assert centre(seen, even) == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 60.0])
def test_surface_cosine(even, tilt_deg):
    seen = direct.layers(wall(1.0, tilt_deg=tilt_deg), even).left.projector_direct
    expected = REFLECTANCE / np.pi * irradiance_at_one_metre(even) * np.cos(np.deg2rad(tilt_deg))
    assert centre(seen, even) == pytest.approx(expected, rel=0.005)


def test_fronto_parallel_wall_is_even(even):
    seen = direct.layers(wall(1.0), even).left.projector_direct
    assert seen.max() / seen.min() == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize("falloff", [2.0, 4.0])
def test_emitter_profile_is_as_set(even, falloff):
    dimmed = dataclasses.replace(
        even, projector=dataclasses.replace(even.projector, falloff=falloff)
    )
    scene = wall(1.0)
    ratio = (
        direct.layers(scene, dimmed).left.projector_direct
        / direct.layers(scene, even).left.projector_direct
    )
    column = np.arange(even.width)
    angle = np.arctan(np.hypot((column - even.cx_px) / even.fx_px, 0))
    np.testing.assert_allclose(ratio[round(even.cy_px)], np.cos(angle) ** falloff, rtol=0.005)


def test_ambient_wall(even):
    seen = direct.layers(wall(1.0), even).left
    assert centre(seen.ambient, even) == pytest.approx(REFLECTANCE / np.pi, rel=1e-4)


def test_all_power_lands_on_the_plane(even):
    """Energy conservation: the irradiance of all emitters over the unit plane is 1 W."""
    part = presets.load("d415").projector
    half_x, half_y = emission.half_tangents(part)
    images = [
        emission.irradiance_at_unit_distance(part, number) for number in range(len(part.emitters))
    ]
    total = sum(float(image.mean(dtype=np.float64)) * 4 * half_x * half_y for image in images)
    assert total == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize(
    "material", [materials.WOOD, materials.PLASTIC, materials.POLISHED_ALUMINIUM]
)
def test_no_material_returns_more_than_it_gets(even, material):
    """Furnace test: even ambient light of irradiance 1 gives radiance of at most 1 / pi."""
    sheet = solids.body("wall", solids.plane(20, 20), material, frames.pose((0, 0, 1.0)))
    light = Ambient(gradient=0.0)
    mi_scene = mitsuba_scene.MitsubaScene(Scene(name="wall", bodies=(sheet,), ambient=light))
    assert direct.layers(mi_scene, even).left.ambient.max() <= (1 + 1e-5) / np.pi


def test_other_ambient_light_recompiles_nothing(even):
    """Another gradient recompiles no kernel; compilation takes as long as rendering."""
    dr, lit = backend.drjit(), wall(1.0)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for up, gradient in (((0.0, -1.0, 0.0), 0.31), ((0.0, -0.6, -0.8), 0.72)):
            dr.kernel_history_clear()
            light = Ambient(gradient=gradient, up=up)
            direct.layers(lit.with_scene(dataclasses.replace(lit.scene, ambient=light)), even)
            ran = [kernel for kernel in dr.kernel_history() if kernel["type"] == dr.KernelType.JIT]
    assert ran and all(kernel["cache_hit"] and not kernel["cache_disk"] for kernel in ran)
