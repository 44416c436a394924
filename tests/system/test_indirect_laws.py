"""Light that comes another way than straight from the projector: how much of it there must be.

Rationale: in a closed room all light that enters is absorbed by the walls, and between matt
surfaces light obeys the radiosity equation, whatever the paths' random numbers are.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.imaging.lens_input import received
from starling.sim.render import backend, emission, indirect, mitsuba_scene, paths, paths_scalar
from starling.sim.render import direct as render
from starling.sim.render.lights import Lights
from starling.sim.render.rays import cameras
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets

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


def lit(made: mitsuba_scene.Stage, sensor, *, samples: int, seed: int = 0):
    layers = render.layers(made, sensor)
    return indirect.add(layers, made, sensor, samples=samples, seed=seed)


@pytest.mark.parametrize("reflectance", [0.5, BRIGHT])
def test_integrating_sphere(even, reflectance):
    """Indirect radiance rho^2 P / (pi A (1 - rho)) everywhere on a sphere's inside, to 0.5 %.

    Source: Goebel, Generalized integrating-sphere theory, 1967: every patch of a sphere receives
    as much from every other, rho P / A after the first bounce and 1 / (1 - rho) of it after all.

    It does not prove how light falls off with distance and angle: in a sphere both cancel.
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
    seen = lit(mitsuba_scene.Stage(Scene(name="sphere", shapes=(ball,))), even, samples=4096).left
    area = 4 * np.pi * radius**2
    expected = reflectance**2 / (np.pi * area * (1 - reflectance))
    assert seen.projector_indirect.mean() == pytest.approx(expected, rel=0.005)
    blocks = seen.projector_indirect.reshape(4, 16, 4, 16).mean(axis=(1, 3))
    np.testing.assert_allclose(blocks, expected, rtol=0.03)


@pytest.mark.slow
def test_energy_in_is_energy_out_in_a_white_box(even):
    """The walls of a closed box absorb the projector's power, direct and indirect, to 0.5 %.

    Six views of 90 degrees see every wall once. A wall of albedo rho that sends out radiance L
    receives pi L / rho and keeps 1 - rho of it; a pixel is (z / f)^2 of a wall.

    It does not prove where on the walls the light falls.
    """
    size = np.array([2.0, 1.6, 2.4])
    room = solids.box(tuple(size))
    room.invert()
    white = Material(name="white", reflectance=BRIGHT)
    body = solids.body("room", room, white)
    made = mitsuba_scene.Stage(Scene(name="box", bodies=(body,)))
    even = dataclasses.replace(
        even, width=128, height=128, fx_px=64.0, fy_px=64.0, cx_px=63.5, cy_px=63.5
    )
    slope = (np.arange(128) - 63.5) / 64
    rays = np.stack([*np.meshgrid(slope, slope), np.ones((128, 128))], axis=-1)
    absorbed = 0.0
    turns = [(0, 0, 0), (0, 90, 0), (0, 180, 0), (0, -90, 0), (90, 0, 0), (-90, 0, 0)]
    for number, turn in enumerate(turns):
        # The camera turns, the projector does not: it lights one wall of the room.
        view = frames.pose((0, 0, 0), turn)
        part = dataclasses.replace(
            even.projector, rotation_deg=tuple(-float(angle) for angle in turn)
        )
        sensor = dataclasses.replace(even, projector=part)
        posed = mitsuba_scene.Stage(dataclasses.replace(made.scene, world_from_left=view))
        layers = lit(posed, sensor, samples=128, seed=number)
        seen, normals = layers.left, layers.truth.normal
        radiance = seen.projector_direct + seen.projector_indirect
        stretch = 1 / np.abs((normals * rays).sum(-1))
        area = (seen.depth_m / sensor.fx_px) ** 2 * stretch
        absorbed += float((radiance * area).sum(dtype=np.float64)) * np.pi / BRIGHT * (1 - BRIGHT)
    assert absorbed == pytest.approx(1.0, rel=0.005)


CORNER_M = 1.5  # From the camera to the edge in which two plates meet.
PLATE_M = 1.0
PATCHES = 24  # A side, of each plate.


def corner_factor(away_m, height_m, low_m, high_m):
    """Form factor from an element to a rectangle in a perpendicular plane, in closed form.

    The element is `away_m` from the line where the planes meet, the rectangle reaches from that
    line to `height_m`, and along it from `low_m` to `high_m`, counted from the element.

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
    """Light between two plates at a right angle is what their form factors say, to 1 %.

    The plates are alike and lit alike, so one plate's radiosity M = rho (E + F M) says all; F is
    in closed form from elements to rectangles. Compared in bands beside the line where the
    plates meet, through the whole chain: coarse paths, low-pass, raising.

    It does not prove how other than matt surfaces pass light on, and not what is nearer to the
    line than 5 cm, a few coarse pixels, where the low-pass rounds the light's steepest rise.
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
    made = mitsuba_scene.Stage(Scene(name="corner", bodies=tuple(plates)))
    layers = lit(made, sensor, samples=64)
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
        found = seen.projector_indirect.ravel()[points]
        assert found.mean() == pytest.approx(expected.mean(), rel=0.01)


def test_paths_agree_with_mitsubas_path_tracer(even):
    """Mean and picture of own paths and of Mitsuba's, on matt and glossy things, to 2 %."""
    made = mitsuba_scene.Stage(scenes.clutter())
    dots = emission.irradiance_at_unit_distance(even.projector)
    camera, _ = cameras(even, made.scene.world_from_left)
    own = paths.radiance(made, camera, Lights.of(made, even), 512, 1)
    theirs = paths_scalar.radiance(
        made, even, made.scene.world_from_left, [dots], shrink=1, samples=512, seed=1
    )
    assert own.mean() == pytest.approx(theirs.mean(), rel=0.02)
    small_own, small_theirs = (cv2.blur(image, (5, 5)).ravel() for image in (own, theirs))
    assert np.corrcoef(small_own, small_theirs)[0, 1] > 0.98
    seen = paths.surfaces(made, camera)
    plugged = paths_scalar.surfaces(made, even, made.scene.world_from_left, shrink=1)
    for name in ("albedo", "depth_m", "normal"):
        apart = np.abs(getattr(seen, name) - getattr(plugged, name))
        assert np.quantile(apart, 0.99) < 2e-3


def test_a_mirror_shows_indirect_light_once(even):
    """What a mirror shows of directly lit surfaces is direct light, not indirect light too.

    The projector lights the wall behind the camera, which sees it in a mirror. What is left is
    light that goes from the wall by the mirror to the wall again: the mirror, 1 m wide and 2 m
    from the wall, is seen from there under less than 1 / (4 pi) of the hemisphere's cosine.
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
    seen = lit(mitsuba_scene.Stage(Scene(name="mirror", bodies=bodies)), sensor, samples=64).left
    shown = seen.body == 1
    direct = seen.projector_direct[shown].mean()
    assert direct > 0
    assert 0 < seen.projector_indirect[shown].mean() < direct / (4 * np.pi)


def test_all_bounces_cost_equal_bits_for_equal_seeds(even):
    made = mitsuba_scene.Stage(scenes.tabletop())
    first, again, other = (
        lit(made, even, samples=4, seed=seed).left.projector_indirect for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_ambient_light_leaves_the_dots_amplitude():
    """Before noise and exposure, more ambient light adds the same to dots and to what is between.

    It does not prove what auto exposure makes of it: a shorter exposure, dimmer dots.
    """
    sensor = presets.load("d435")
    view = render.layers(mitsuba_scene.Stage(scenes.wall(1.0)), sensor, subpixels=1).left
    dim, bright = (
        received(
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
