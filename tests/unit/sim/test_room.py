"""Furnished rooms: closed, of the stated size, with furniture on the floor and no overlap."""

from __future__ import annotations

import numpy as np
import pytest

from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene.builtin import furniture
from starling.sim.scene.builtin.room import room
from starling.sim.sensor import edits, presets

SMALL = {"width": 128, "height": 72, "fx_px": 90.0, "fy_px": 90.0, "cx_px": 63.5, "cy_px": 35.5}


@pytest.mark.parametrize("seed", range(8))
def test_every_ray_ends_within_the_room(seed: int):
    sensor = edits.with_values(presets.load("d415"), SMALL.items())
    depth_m = direct.layers(
        mitsuba_scene.MitsubaScene(room(seed)), sensor, subpixels=1
    ).truth.depth_m
    assert np.isfinite(depth_m).all()
    assert depth_m.min() > 0.3 and depth_m.max() < 11


@pytest.mark.parametrize("seed", range(8))
def test_furniture_is_on_the_floor_between_the_walls(seed: int):
    bodies = {body.name: body.mesh.vertices for body in room(seed).bodies}
    floor = bodies["floor"][0, 1]
    left, right = bodies["wall left"][0, 0], bodies["wall right"][0, 0]
    standing = [name for name in bodies if name.split()[0] not in ("wall", "floor", "ceiling")]
    assert len(standing) > 4
    for name in standing:
        low, high = bodies[name].min(axis=0), bodies[name].max(axis=0)
        assert left - 1e-4 < low[0] and high[0] < right + 1e-4, name
        assert high[1] < floor + 1e-4 or name.startswith(("plant", "picture")), name


def test_furniture_does_not_overlap():
    pieces: dict[str, list[np.ndarray]] = {}
    for body in room(3).bodies:
        number, dot, _ = body.name.split()[-1].partition(".")
        if dot:
            pieces.setdefault(number, []).append(body.mesh.vertices[:, [0, 2]])
    corners = [np.concatenate(parts) for parts in pieces.values()]
    assert len(corners) > 4
    for index, one in enumerate(corners):
        for different in corners[:index]:
            apart = np.hypot(*(one[:, None] - different[None]).transpose(2, 0, 1))
            assert apart.min() > 1e-3


def test_the_seed_draws_all_of_it():
    first, again, different = room(1), room(1), room(2)
    for one, two in zip(first.bodies, again.bodies, strict=True):
        np.testing.assert_array_equal(one.mesh.vertices, two.mesh.vertices)
        assert one.material == two.material
    assert not np.array_equal(first.world_from_left, different.world_from_left)


def test_every_kind_of_furniture_is_drawn():
    rng = np.random.default_rng(0)
    pieces = [furniture.draw_piece(rng) for _ in range(200)]
    names = {part.name for piece in pieces for part in piece.parts}
    assert {"table top", "chair seat", "shelf", "book", "sofa", "lamp shade", "plant"} <= names
    for piece in pieces:
        for part in piece.parts:
            reach = np.hypot(part.solid.vertices[:, 0], part.solid.vertices[:, 2]).max()
            assert reach <= piece.radius_m + 1e-9 and part.solid.vertices[:, 1].max() < 0.4
