"""Meshes dropped onto a table: each rests in a stable pose, and none intersects another.

The fall is not simulated. A mesh takes one of its stable poses, in which its centre of mass is
above a face of its convex hull. The pose is drawn by its probability under a random throw, as
`trimesh` computes it (Goldberg et al., Part pose statistics, Int. J. Robotics Research 18(9),
1999). The rotation about the vertical is random. The position is random too, such that the circles
around the footprints do not overlap.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.datasets.source import Pile
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene import materials, sources
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material, Scene
from starling.sim.sensor.sensor import Sensor

_TABLE_M = (2.0, 0.04, 1.4)  # Width, thickness and depth of the table [m].
_UP = (0.0, 1.0, 0.0)  # Up direction of the world; the table top is y = 0.
_SPREAD = 1.3  # Radius of the pile over the radius of a circle with the footprints' total area.
_TRIES = 200  # Random positions tried before the pile's radius grows.
_WIDER = 1.1  # Factor by which the radius grows.
_FILLED = 0.75  # Share of the image width that the pile's circle fills.
_LEAST_VOLUME = 1e-9  # Share of a hull's diagonal cubed; trimesh never ends for a flat hull.
_POSES = 64  # Largest number of stable poses of a mesh; the most probable ones are used.
_FROM_Z = np.array(frames.pose((0, 0, 0), (-90, 0, 0)))  # Turns z of a stable pose to the vertical.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RestingMesh:
    """One mesh at rest."""

    name: str  # Name of its body.
    path: Path
    mesh: str  # Path inside the source's folder, with forward slashes.
    world_from_mesh: Pose  # Rigid, translation in metres.
    reflectance: float


def scene(pile: Pile, sensor: Sensor) -> tuple[Scene, tuple[RestingMesh, ...]]:
    """Place a pile of meshes on a table in a room, seen from the front and above.

    Args:
        pile: meshes [m], and the seed of their poses.
        sensor: camera; the pile fills most of its image width.

    Returns:
        The scene and the resting meshes, in the order of the scene's last bodies. The world's y is
        up, and its origin is in the middle of the table top.

    Raises:
        InputError: if a mesh is missing or damaged, or the pile is larger than the table.
    """
    chosen, spots = _placed(pile)
    resting = tuple(
        RestingMesh(
            name=f"{path.stem} {number}",
            path=path,
            mesh=path.relative_to(pile.folder).as_posix(),
            world_from_mesh=frames.pose((float(x), 0.0, float(z))) @ pose,
            reflectance=reflectance,
        )
        for number, (path, (pose, _), (x, z), reflectance) in enumerate(
            zip(pile.paths, chosen, spots, pile.reflectances, strict=True)
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
    things = tuple(_body(rested) for rested in resting)
    reach = max(
        float(np.hypot(*spot)) + radius for spot, (_, radius) in zip(spots, chosen, strict=True)
    )
    height = max(float(body.world_mesh.vertices[:, 1].max()) for body in things)
    return (
        Scene(
            name=pile.room,
            bodies=(wall, floor, table, *things),
            ambient=Ambient(up=_UP),
            world_from_left=_camera_pose(reach, height, sensor),
        ),
        resting,
    )


def refuse_crowded(pile: Pile) -> None:
    """Refuse a pile that `scene` refuses, without loading its bodies.

    Raises:
        InputError: as `scene`.
    """
    _placed(pile)


def _placed(pile: Pile) -> tuple[list[tuple[Pose, float]], list[tuple[float, float]]]:
    """Draw the pose and radius of each mesh, and its place on the table."""
    rng = np.random.default_rng(pile.seed)
    chosen = [_at_rest(path, rng) for path in pile.paths]
    return chosen, _spots([radius for _, radius in chosen], rng)


def _at_rest(path: Path, rng: np.random.Generator) -> tuple[Pose, float]:
    """Draw a resting pose on y = 0, centred on the vertical axis; return it and its radius [m]."""
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
    """Return stable poses (n, 4, 4) on z = 0, their probabilities, and the hull's points."""
    whole = solids.join([part for _, part in sources.mesh_parts(path)])
    rule = "must be a solid that can rest on a table"
    try:
        with np.errstate(all="ignore"):  # A flat hull has no centre of mass.
            hull = whole.convex_hull
            flat = not hull.volume > _LEAST_VOLUME * hull.scale**3
        poses, chances = (None, None) if flat else hull.compute_stable_poses(sigma=0.0)
    except Exception as error:  # trimesh raises various exceptions for a hull without volume.
        raise errors.refuse("mesh", rule, path, f"trimesh: {type(error).__name__}.") from None
    if poses is None or chances is None:
        raise errors.refuse("mesh", rule, path, "It is flat: give it a thickness.")
    likely = np.argsort(-chances, kind="stable")[:_POSES]
    return poses[likely], chances[likely] / chances[likely].sum(), np.asarray(hull.vertices)


def _spots(radii: list[float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Draw centres (x, z) [m] of footprints that do not overlap, close to each other."""
    wide = _SPREAD * float(np.sqrt(np.sum(np.square(radii))))
    spots: list[tuple[float, float]] = []
    for number, radius in enumerate(radii):
        tries = 0
        while True:
            x, z = rng.uniform(-wide, wide, size=2)
            free = all(
                np.hypot(x - spots[earlier][0], z - spots[earlier][1]) > radius + radii[earlier]
                for earlier in range(number)
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


def _body(rested: RestingMesh) -> Body:
    parts = solids.join([part for _, part in sources.mesh_parts(rested.path)])
    material = Material(name=rested.name, reflectance=rested.reflectance)
    return solids.body(rested.name, parts, material, rested.world_from_mesh)


def _camera_pose(reach_m: float, height_m: float, sensor: Sensor) -> Pose:
    """Return the camera's pose, 35 degrees above the table.

    The distance lets the pile fill most of the image width, within the sensor's range and search.
    """
    half = sensor.width / sensor.fx_px / 2
    nearest = max(sensor.post.near_m, sensor.focal_baseline_px_m / sensor.matcher.search_px)
    far = max(reach_m / (_FILLED * half), 1.3 * nearest + reach_m)
    angle = np.deg2rad(35)
    eye = (0.0, height_m / 2 + far * float(np.sin(angle)), far * float(np.cos(angle)))
    return frames.look_at(eye, (0.0, height_m / 2, 0.0), _UP)
