"""Meshes dropped onto a table: each lies as it could at rest, and none stands in another.

Nothing falls: a mesh takes one of the poses in which its centre of mass lies above a face of its
convex hull, by their probabilities under a random throw (Goldberg et al., Part pose statistics,
Int. J. Robotics Research 18(9), 1999, as `trimesh` computes them), turned about the vertical by
lot, where the circles about the others' footprints leave room.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.datasets.source import Heap
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene import materials, mesh
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material, Scene
from starling.sim.sensor.sensor import Sensor

_TABLE_M = (2.0, 0.04, 1.4)
_UP = (0.0, 1.0, 0.0)  # Of the world: the table's top is y = 0.
_SPREAD = 1.3  # Radius of the heap over that of its footprints laid out without gaps.
_TRIES = 200  # For a place, before the heap may grow,
_WIDER = 1.1  # by so much.
_FILLED = 0.75  # Share of the image's width that the heap's circle fills.
_POSES = 64  # Of a mesh, the most likely ones.
_FROM_Z = np.array(frames.pose((0, 0, 0), (-90, 0, 0)))  # z of a stable pose to the vertical.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lying:
    """One mesh at rest."""

    name: str  # Of its body.
    path: Path
    world_from_mesh: Pose  # Rigid, metres.
    reflectance: float


def scene(heap: Heap, sensor: Sensor) -> tuple[Scene, tuple[Lying, ...]]:
    """Lay a heap out on a table in a room, seen from the front and above.

    Args:
        heap: meshes in metres, and the seed of where they lie.
        sensor: whose width the heap fills for the most part.

    Returns:
        The scene, its world's y up and origin in the middle of the table's top; and where the
        meshes lie, in the order of its last bodies.

    Raises:
        InputError: if a mesh is missing or damaged, or the heap is larger than the table.
    """
    rng = np.random.default_rng(heap.seed)
    chosen = [_at_rest(path, rng) for path in heap.paths]
    spots = _spots([radius for _, radius in chosen], rng)
    lying = tuple(
        Lying(
            name=f"{path.stem} {number}",
            path=path,
            world_from_mesh=frames.pose((float(x), 0.0, float(z))) @ pose,
            reflectance=reflectance,
        )
        for number, (path, (pose, _), (x, z), reflectance) in enumerate(
            zip(heap.paths, chosen, spots, heap.reflectances, strict=True)
        )
    )
    table = solids.body(
        "table", solids.box(_TABLE_M), materials.WOOD, frames.pose((0, -_TABLE_M[1] / 2, 0))
    )
    wall = solids.body(
        "wall", solids.plane(12, 8), materials.WALL_PAINT, frames.pose((0, 0, -1.6), (180, 0, 0))
    )
    floor = solids.body(
        "floor", solids.box((12, 0.02, 8)), materials.CARDBOARD, frames.pose((0, -0.75, 0))
    )
    things = tuple(_body(one) for one in lying)
    reach = max(
        float(np.hypot(*spot)) + radius for spot, (_, radius) in zip(spots, chosen, strict=True)
    )
    height = max(float(body.mesh.vertices[:, 1].max()) for body in things)
    return (
        Scene(
            name=heap.room,
            bodies=(wall, floor, table, *things),
            ambient=Ambient(up=_UP),
            world_from_left=_seen(reach, height, sensor),
        ),
        lying,
    )


def _at_rest(path: Path, rng: np.random.Generator) -> tuple[Pose, float]:
    """A pose in which a mesh rests on y = 0, about the vertical, and its footprint's radius."""
    poses, chances, points = _stable(path)
    pose = poses[int(rng.choice(len(poses), p=chances))]
    turned = frames.pose((0, 0, 0), (0, float(rng.uniform(0, 360)), 0)) @ _FROM_Z @ pose
    placed = points @ turned[:3, :3].T + turned[:3, 3]
    low, high = placed.min(axis=0), placed.max(axis=0)
    middle = frames.pose((-(low[0] + high[0]) / 2, -low[1], -(low[2] + high[2]) / 2))
    placed = placed + middle[:3, 3]
    return middle @ turned, float(np.hypot(placed[:, 0], placed[:, 2]).max())


@lru_cache(maxsize=256)
def _stable(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Poses (n, 4, 4) that a mesh rests in on z = 0, their chances, and its hull's points."""
    whole = solids.joined([part for _, part in mesh.parts(path)])
    try:
        hull = whole.convex_hull
        poses, chances = hull.compute_stable_poses(sigma=0.0)
    except Exception as error:  # A flat hull has no volume, and trimesh many ways to say so.
        rule = "must be a solid that can rest on a table"
        raise errors.refuse("mesh", rule, path, f"trimesh: {type(error).__name__}.") from None
    kept = np.argsort(-chances, kind="stable")[:_POSES]
    return poses[kept], chances[kept] / chances[kept].sum(), np.asarray(hull.vertices)


def _spots(radii: list[float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Middles (x, z) of footprints that do not overlap, as near to each other as a lot finds."""
    wide = _SPREAD * float(np.sqrt(np.sum(np.square(radii))))
    spots: list[tuple[float, float]] = []
    for number, radius in enumerate(radii):
        tries = 0
        while True:
            x, z = rng.uniform(-wide, wide, size=2)
            free = all(
                np.hypot(x - spots[other][0], z - spots[other][1]) > radius + radii[other]
                for other in range(number)
            )
            if free and np.hypot(x, z) <= wide:
                spots.append((float(x), float(z)))
                break
            tries += 1
            if tries % _TRIES == 0:
                wide *= _WIDER
            if wide + radius > min(_TABLE_M[0], _TABLE_M[2]) / 2:
                rule = f"must have room on a table of {_TABLE_M[0]:g} x {_TABLE_M[2]:g} m"
                raise errors.refuse(
                    "meshes", rule, f"{len(radii)} of them", "Drop fewer, or scale them to metres."
                )
    return spots


def _body(one: Lying) -> Body:
    parts = solids.joined([part for _, part in mesh.parts(one.path)])
    material = Material(name=one.name, reflectance=one.reflectance)
    return solids.body(one.name, parts, material, one.world_from_mesh)


def _seen(reach_m: float, height_m: float, sensor: Sensor) -> Pose:
    """From 35 degrees above, as near as the heap's circle fills most of the width, or the sensor's
    range and search let.
    """
    half = sensor.width / sensor.fx_px / 2
    nearest = max(sensor.post.near_m, sensor.focal_baseline_px_m / sensor.matcher.search_px)
    far = max(reach_m / (_FILLED * half), 1.3 * nearest + reach_m)
    angle = np.deg2rad(35)
    eye = (0.0, height_m / 2 + far * float(np.sin(angle)), far * float(np.cos(angle)))
    return frames.look_at(eye, (0.0, height_m / 2, 0.0), _UP)
