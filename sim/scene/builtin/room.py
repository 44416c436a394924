"""A random furnished room, the typical indoor scene of a depth camera.

The room has walls, floor and ceiling, furniture on free floor, and pictures on the walls. Furniture
has common sizes; positions and reflectances are random. The world frame is level, with its origin
in the left imager: x right, y down, z into the room.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene.builtin import furniture, solids
from starling.sim.scene.builtin.furniture import FurniturePiece, Rng
from starling.sim.scene.scene import Body, Material, Mesh, Scene

_WIDTH_M, _DEPTH_M, _HEIGHT_M = (2.5, 6.0), (2.5, 8.0), (2.3, 2.9)  # Ranges of the room's size [m].
_EYE_M = (0.6, 1.6)  # Range of the camera's height [m].
_BEHIND_M = 0.5  # Distance from the camera to the wall behind it [m].
_NEAREST_M = 0.5  # Least distance from the camera to furniture [m].
_PIECES = (7, 16)  # Range of the number of pieces of furniture.
_TRIES = 60  # Attempts to find free floor for a piece.
_PICTURES = (2, 7)  # Range of the number of pictures.
_PITCH_DEG, _YAW_DEG = (-22.0, 8.0), (-25.0, 25.0)  # Ranges of the camera's angles; down < 0 [deg].


def room(seed: float = 0) -> Scene:
    """Generate a furnished room of 2.5 to 6 m by 3 to 8.5 m, seen from one end."""
    rng = np.random.default_rng([int(seed), 9])
    width, depth, height = (float(rng.uniform(*ends)) for ends in (_WIDTH_M, _DEPTH_M, _HEIGHT_M))
    eye, aside = float(rng.uniform(*_EYE_M)), float(rng.uniform(-0.3, 0.3)) * width
    left, right = aside - width / 2, aside + width / 2
    bodies = _shell(left, right, depth, eye, height, rng)
    standing: list[tuple[float, float, float]] = []  # x, z and radius.
    for number in range(int(rng.integers(*_PIECES))):
        piece = furniture.draw_piece(rng)
        spot = _spot(piece.radius_m, left, right, depth, standing, rng)
        if spot is not None:
            standing.append((*spot, piece.radius_m))
            turn = (0.0, float(rng.uniform(0, 360)), 0.0)
            bodies += _placed(piece, frames.pose((spot[0], eye, spot[1]), turn), number)
    yaw = frames.pose((0, 0, 0), (0, float(rng.uniform(*_YAW_DEG)), 0))
    look = yaw @ frames.pose((0, 0, 0), (float(rng.uniform(*_PITCH_DEG)), 0, 0))
    return Scene(name=f"room:{int(seed)}", bodies=tuple(bodies), world_from_left=look)


def _spot(
    radius: float,
    left: float,
    right: float,
    depth: float,
    standing: list[tuple[float, float, float]],
    rng: Rng,
) -> tuple[float, float] | None:
    """Find free floor for a circle; None if all attempts fail."""
    for _ in range(_TRIES):
        x, z = float(rng.uniform(left, right)), float(rng.uniform(0, depth))
        inside = left + radius < x < right - radius and z < depth - radius
        if (
            inside
            and np.hypot(x, z) > _NEAREST_M + radius
            and all(
                np.hypot(x - piece_x, z - piece_z) > radius + piece_radius
                for piece_x, piece_z, piece_radius in standing
            )
        ):
            return x, z
    return None


def _placed(piece: FurniturePiece, pose: Pose, number: int) -> list[Body]:
    return [
        solids.body(
            f"{part.name} {number}.{index}", part.solid, part.material, pose, smooth=part.smooth
        )
        for index, part in enumerate(piece.parts)
    ]


def _shell(
    left: float, right: float, depth: float, eye: float, height: float, rng: Rng
) -> list[Body]:
    """Walls, floor, ceiling and pictures."""
    width, long, middle = right - left, depth + _BEHIND_M, (depth - _BEHIND_M) / 2
    top, x = eye - height, (left + right) / 2
    y = (eye + top) / 2
    walls = {  # Name: pose of a sheet that faces -z, width, height.
        "wall ahead": (frames.pose((x, y, depth)), width, height),
        "wall left": (frames.pose((left, y, middle), (0, -90, 0)), long, height),
        "wall right": (frames.pose((right, y, middle), (0, 90, 0)), long, height),
        "floor": (frames.pose((x, eye, middle), (-90, 0, 0)), width, long),
        "ceiling": (frames.pose((x, top, middle), (90, 0, 0)), width, long),
    }
    paint = _matt(rng.uniform(0.3, 0.85))
    bodies = []
    for name, (pose, wide, tall) in walls.items():
        sheet = solids.plane(wide, tall)
        if name == "floor":
            bodies.append(_textured(name, wide, tall, pose, rng))
        else:
            bodies.append(solids.body(name, sheet, paint, pose))
    for number in range(int(rng.integers(*_PICTURES))):
        pose, wide, tall = walls[("wall ahead", "wall left", "wall right")[number % 3]]
        size = (float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.2, 1.2)))
        place = (
            float(rng.uniform(-0.5, 0.5)) * max(wide - size[0], 0.1),
            float(rng.uniform(-0.4, 0.3)) * max(tall - size[1], 0.1),
            -float(rng.uniform(0.01, 0.06)),
        )
        bodies.append(_textured(f"picture {number}", *size, pose @ frames.pose(place), rng))
    return bodies


def _matt(reflectance: float) -> Material:
    return Material(name="paint", reflectance=float(reflectance))


def _textured(name: str, width: float, height: float, pose: Pose, rng: Rng) -> Body:
    """A sheet with a random texture."""
    sheet = solids.plane(width, height)
    sheet.apply_transform(pose)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    plain = solids.mesh(sheet, smooth=False)
    mesh = Mesh(vertices=plain.vertices, faces=plain.faces, uv=corners)
    return Body(name=name, mesh=mesh, material=_matt(0.5), texture=_pattern(rng))


def _pattern(rng: Rng) -> NDArray[np.float32]:
    """Random reflectance (128, 128) with detail from coarse to fine."""
    texture = np.zeros((128, 128), np.float32)
    for cells in (3, 9, 27, 81):
        grid = rng.uniform(-1, 1, (cells, cells)).astype(np.float32)
        sharp = cv2.INTER_NEAREST if rng.random() < 0.3 else cv2.INTER_CUBIC
        texture += float(rng.random()) * np.asarray(
            cv2.resize(grid, (128, 128), interpolation=sharp)
        )
    contrast = float(rng.uniform(0.05, 0.6)) / max(float(np.abs(texture).max()), 1e-6)
    mean = float(rng.uniform(0.15, 0.7))
    return np.clip(mean * (1 + contrast * texture), 0.02, 0.95).astype(np.float32)
