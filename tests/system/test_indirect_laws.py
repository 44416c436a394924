"""Indirect light: energy conservation and the radiosity equation.

Rationale: the walls of a closed room absorb all light. Between diffuse surfaces light obeys the
radiosity equation.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.imaging.lens_input import combine_light
from starling.sim.render import backend, emission, indirect, mitsuba_scene, paths, scalar
from starling.sim.render import direct as render
from starling.sim.render.lights import Lights
from starling.sim.render.rays import cameras
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets

pytestmark = pytest.mark.slow

BRIGHT = 0.9


@pytest.fixture
def even(tmp_path):
    """A small wide-angle camera with an even projector at the left imager's place."""
    path = tmp_path / "even.png"
    cv2.imwrite(str(path), np.full((96, 96), 200, np.uint8))
    preset = presets.load("d435")
    part = dataclasses.replace(
        preset.projector,
        pattern=str(path),
        position_m=(0.0, 0.0, 0.0),
        fov_x_deg=100.0,
        fov_y_deg=100.0,
    )
    return dataclasses.replace(
        preset, width=64, height=64, fx_px=32.0, fy_px=32.0, cx_px=31.5, cy_px=31.5, projector=part
    )


def lit(mi_scene: mitsuba_scene.MitsubaScene, sensor, *, samples: int, seed: int = 0):
    layers = render.layers(mi_scene, sensor)
    return indirect.add(layers, mi_scene, sensor, samples=samples, seed=seed)


@pytest.mark.parametrize("reflectance", [0.5, BRIGHT])
def test_integrating_sphere(even, reflectance):
    """Indirect radiance rho^2 P / (pi A (1 - rho)) everywhere on a sphere's inside, to 0.5 %.

    Source: Goebel, Generalized integrating-sphere theory, 1967. Each patch of a sphere receives
    equal light from all others: rho P / A after the first bounce, times 1 / (1 - rho) in total.

    The test is insensitive to distance and angle, whose effects cancel in a sphere.
    """
    mi = backend.mitsuba()
    radius = 1.3
    ball = mi.load_dict(
        {
            "type": "sphere",
            "radius": radius,
            "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": reflectance}},
        }
    )
    seen = lit(
        mitsuba_scene.MitsubaScene(Scene(name="sphere", shapes=(ball,))), even, samples=4096
    ).left
    area = 4 * np.pi * radius**2
    expected = reflectance**2 / (np.pi * area * (1 - reflectance))
    assert seen.projector_indirect.mean() == pytest.approx(expected, rel=0.005)
    blocks = seen.projector_indirect.reshape(4, 16, 4, 16).mean(axis=(1, 3))
    np.testing.assert_allclose(blocks, expected, rtol=0.03)


def test_energy_in_is_energy_out_in_a_white_box(even):
    """The walls of a closed box absorb the projector's power, direct and indirect, to 0.5 %.

    Six views of 90 degrees see each wall once. A wall of albedo rho and radiance L receives
    pi L / rho and absorbs 1 - rho of it. A pixel covers (z / f)^2 of a wall.

    The test does not show where on the walls the light falls.
    """
    size = np.array([2.0, 1.6, 2.4])
    room = solids.box(tuple(size))
    room.invert()
    white = Material(name="white", reflectance=BRIGHT)
    body = solids.body("room", room, white)
    mi_scene = mitsuba_scene.MitsubaScene(Scene(name="box", bodies=(body,)))
    even = dataclasses.replace(
        even, width=128, height=128, fx_px=64.0, fy_px=64.0, cx_px=63.5, cy_px=63.5
    )
    slope = (np.arange(128) - 63.5) / 64
    rays = np.stack([*np.meshgrid(slope, slope), np.ones((128, 128))], axis=-1)
    absorbed = 0.0
    turns = [(0, 0, 0), (0, 90, 0), (0, 180, 0), (0, -90, 0), (90, 0, 0), (-90, 0, 0)]
    for number, turn in enumerate(turns):
        # The camera rotates; the projector is fixed and lights one wall.
        view = frames.pose((0, 0, 0), turn)
        part = dataclasses.replace(
            even.projector, rotation_deg=tuple(-float(angle) for angle in turn)
        )
        sensor = dataclasses.replace(even, projector=part)
        posed = mitsuba_scene.MitsubaScene(
            dataclasses.replace(mi_scene.scene, world_from_left=view)
        )
        layers = lit(posed, sensor, samples=128, seed=number)
        seen, normals = layers.left, layers.truth.normal
        radiance = seen.projector_direct + seen.projector_indirect
        stretch = 1 / np.abs((normals * rays).sum(-1))
        area = (seen.depth_m / sensor.fx_px) ** 2 * stretch
        absorbed += float((radiance * area).sum(dtype=np.float64)) * np.pi / BRIGHT * (1 - BRIGHT)
    assert absorbed == pytest.approx(1.0, rel=0.005)


CORNER_M = 1.5  # Distance from the camera to the common edge of the plates [m].
PLATE_M = 1.0
PATCHES = 24  # Patches per side of a plate.


def corner_factor(away_m, height_m, low_m, high_m):
    """Form factor from an element to a rectangle in a perpendicular plane, in closed form.

    The element is at distance `away_m` from the planes' common line. The rectangle extends from
    that line to `height_m`, and along it from `low_m` to `high_m` relative to the element.

    Source: Howell, Menguc and Siegel, A Catalog of Radiation Heat Transfer Configuration Factors,
    B-5 by superposition.
    """
    slant = np.hypot(away_m, height_m)

    def part(along_m):
        return np.arctan(along_m / away_m) - away_m / slant * np.arctan(along_m / slant)

    return (part(high_m) - part(low_m)) / (2 * np.pi)


def gathered(away_m, along_m, exitance):
    """Irradiance at points of one plate from the patches of the other (PATCHES, PATCHES)."""
    steps = np.linspace(0, PLATE_M, PATCHES + 1)
    away, along = np.asarray(away_m)[:, None, None], np.asarray(along_m)[:, None, None]
    low, high = steps[None, None, :-1] - along, steps[None, None, 1:] - along
    to_line = corner_factor(away, np.maximum(steps, 1e-9)[None, :, None], low, high)
    factors = np.diff(to_line, axis=1)  # (points, from the line outwards, along the line)
    return np.einsum("pij,ij->p", factors, exitance)


def direct(away_m, along_m, sensor):
    """Irradiance of an even projector at the camera: E1 / z^2 cos(theta) / cos(alpha)."""
    flat = np.asarray(away_m) / np.sqrt(2)
    point = np.stack([flat, np.asarray(along_m) - PLATE_M / 2, CORNER_M - flat], axis=-1)
    distance = np.linalg.norm(point, axis=-1)
    facing = point @ np.array([1.0, 0.0, 1.0]) / np.sqrt(2) / distance
    half_x, half_y = emission.half_tangents(sensor.projector)
    cos_alpha = point[..., 2] / distance
    return facing / (4 * half_x * half_y * point[..., 2] ** 2 * cos_alpha)


def test_a_corner_agrees_with_the_radiosity_equation(even):
    """Light between two perpendicular plates agrees with their form factors, to 1 %.

    By symmetry one plate's radiosity M = rho (E + F M) suffices. F is the closed form from elements
    to rectangles. The comparison uses bands parallel to the common line and the whole method:
    coarse paths, low-pass, upsampling.

    The test excludes other materials, and points closer than 5 cm to the line. There, within a few
    coarse pixels, the low-pass smooths the light's steep rise.
    """
    sensor = dataclasses.replace(
        even, width=640, height=640, fx_px=360.0, fy_px=360.0, cx_px=319.5, cy_px=319.5
    )
    white = Material(name="white", reflectance=BRIGHT)
    half = PLATE_M / 2 / np.sqrt(2)
    plates = [
        solids.body(
            name,
            solids.plane(PLATE_M, PLATE_M),
            white,
            frames.pose((side * half, 0, CORNER_M - half), (0, side * 45, 0)),
        )
        for name, side in (("right", 1), ("left", -1))
    ]
    mi_scene = mitsuba_scene.MitsubaScene(Scene(name="corner", bodies=tuple(plates)))
    layers = lit(mi_scene, sensor, samples=64)
    centres = (np.arange(PATCHES) + 0.5) / PATCHES * PLATE_M
    away, along = (axis.ravel() for axis in np.meshgrid(centres, centres, indexing="ij"))
    alone = direct(away, along, sensor)
    exitance = BRIGHT * alone
    for _ in range(60):
        exitance = BRIGHT * (alone + gathered(away, along, exitance.reshape(PATCHES, PATCHES)))
    rows, columns = np.indices((640, 640))
    depth = layers.truth.depth_m
    flat = np.abs((columns - sensor.cx_px) / sensor.fx_px * depth)
    height = (rows - sensor.cy_px) / sensor.fy_px * depth + PLATE_M / 2
    seen = layers.left
    for low, high in ((0.05, 0.15), (0.15, 0.4), (0.4, 0.9)):
        band = (flat * np.sqrt(2) > low) & (flat * np.sqrt(2) < high)
        band &= (height > 0.1) & (height < 0.9)
        points = np.flatnonzero(band)[::97]
        x, y = flat.ravel()[points] * np.sqrt(2), height.ravel()[points]
        expected = BRIGHT / np.pi * gathered(x, y, exitance.reshape(PATCHES, PATCHES))
        first = BRIGHT / np.pi * direct(x, y, sensor)
        np.testing.assert_allclose(seen.projector_direct.ravel()[points], first, rtol=0.01)
        measured = seen.projector_indirect.ravel()[points]
        assert measured.mean() == pytest.approx(expected.mean(), rel=0.01)


def test_paths_agree_with_mitsubas_path_tracer(even):
    """`paths` and Mitsuba's path tracer agree on diffuse and glossy objects, to 2 %."""
    mi_scene = mitsuba_scene.MitsubaScene(scenes.clutter())
    dots = emission.irradiance_at_unit_distance(even.projector)
    camera, _ = cameras(even, mi_scene.scene.world_from_left)
    traced = paths.radiance(mi_scene, camera, Lights.from_sensor(mi_scene, even), 512, 1)
    theirs = scalar.radiance(
        mi_scene, even, mi_scene.scene.world_from_left, [dots], shrink=1, samples=512, seed=1
    )
    assert traced.mean() == pytest.approx(theirs.mean(), rel=0.02)
    small_own, small_theirs = (cv2.blur(image, (5, 5)).ravel() for image in (traced, theirs))
    assert np.corrcoef(small_own, small_theirs)[0, 1] > 0.98
    seen = paths.surfaces(mi_scene, camera)
    plugged = scalar.surfaces(mi_scene, even, mi_scene.scene.world_from_left, shrink=1)
    for name in ("albedo", "depth_m", "normal"):
        apart = np.abs(getattr(seen, name) - getattr(plugged, name))
        assert np.quantile(apart, 0.99) < 2e-3


def test_a_mirror_shows_indirect_light_once(even):
    """The mirror image of directly lit surfaces is direct light, not indirect light.

    The projector lights the wall behind the camera, which sees it in a mirror. The only indirect
    light goes from the wall by the mirror back to the wall. Seen from the wall, the mirror (1 m
    wide at 2 m) has a form factor of less than 1 / (4 pi).
    """
    mirror = Material(name="mirror", kind="mirror", reflectance=1.0)
    wall = solids.plane(12, 12)
    wall.apply_transform(frames.pose((0, 0, -1.0), (0, 180, 0)))
    bodies = (
        solids.body("mirror", solids.plane(1, 1), mirror, frames.pose((0, 0, 1.0))),
        solids.body("wall", wall, Material(name="white", reflectance=BRIGHT)),
    )
    part = dataclasses.replace(even.projector, rotation_deg=(0.0, 180.0, 0.0))
    sensor = dataclasses.replace(even, projector=part)
    seen = lit(
        mitsuba_scene.MitsubaScene(Scene(name="mirror", bodies=bodies)), sensor, samples=64
    ).left
    shown = seen.body == 1
    direct = seen.projector_direct[shown].mean()
    assert direct > 0
    assert 0 < seen.projector_indirect[shown].mean() < direct / (4 * np.pi)


def test_all_bounces_cost_equal_bits_for_equal_seeds(even):
    mi_scene = mitsuba_scene.MitsubaScene(scenes.tabletop())
    first, again, different = (
        lit(mi_scene, even, samples=4, seed=seed).left.projector_indirect for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, different)


def test_ambient_light_leaves_the_dots_amplitude():
    """Before noise and exposure, more ambient light adds equally to dots and background.

    The test excludes auto exposure, which would shorten the exposure and dim the dots.
    """
    sensor = presets.load("d435")
    view = render.layers(mitsuba_scene.MitsubaScene(scenes.wall(1.0)), sensor, subpixels=1).left
    dim, bright = (
        combine_light(
            view,
            Scene(
                name="wall",
                bodies=scenes.wall(1.0).bodies,
                ambient=Ambient(irradiance_w_m2=irradiance),
            ),
            sensor,
            seed=0,
            frame=0,
        )
        for irradiance in (0.0, 20.0)
    )
    assert np.array_equal(dim.laser, bright.laser)
    added = (bright.laser + bright.rest) - (dim.laser + dim.rest)
    np.testing.assert_allclose(added, 20.0 * view.ambient, rtol=1e-5)
    assert not dim.rest.any()
