"""Builtin scenes: `wall`, `staircase`, `tabletop`, `clutter` and `room`.

The world frame is the left imager's (x right, y down, z forward).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.scene import materials
from starling.sim.scene.builtin import solids
from starling.sim.scene.builtin.room import room
from starling.sim.scene.scene import Body, Material, Scene

_DOWN = np.array([0.0, 1.0, 0.0])
_UPRIGHT = frames.pose((0, 0, 0), (90, 0, 0))  # Turns a solid's z axis to the vertical.


def wall(distance_m: float = 1.0) -> Scene:
    """A painted, fronto-parallel wall at `distance_m`."""
    sheet = solids.plane(8 * distance_m, 8 * distance_m)
    body = solids.body("wall", sheet, materials.WALL_PAINT, frames.pose((0, 0, distance_m)))
    return Scene(name=f"wall:{distance_m:g}", bodies=(body,))


def staircase(nearest_m: float = 0.6) -> Scene:
    """Eight adjacent fronto-parallel strips, each 25 % farther than the previous one."""
    strips = []
    for step in range(8):
        depth = nearest_m * 1.25**step
        left = (-1 + step / 4) * depth  # Each strip fills an eighth of a 90 degree field.
        strip = solids.plane(depth / 4, 3 * depth)
        pose = frames.pose((left + depth / 8, 0, depth))
        strips.append(solids.body(f"step {step}", strip, materials.PAPER, pose))
    back = nearest_m * 1.25**8
    sheet = solids.plane(6 * back, 6 * back)
    strips.append(solids.body("back", sheet, materials.WALL_PAINT, frames.pose((0, 0, back))))
    return Scene(name=f"staircase:{nearest_m:g}", bodies=tuple(strips))


def tabletop(seed: float = 0) -> Scene:
    """A table with eight objects in two rows, in front of a wall."""
    return _on_table("tabletop", int(seed), spots=(4, 2), spread_m=(0.2, 0.24), jitter=0.25)


def clutter(seed: float = 0) -> Scene:
    """A crowded table with thirty overlapping objects of all kinds, in front of a wall."""
    return _on_table("clutter", int(seed), spots=(6, 5), spread_m=(0.17, 0.16), jitter=0.45)


BUILTIN: dict[str, tuple[Callable[..., Scene], str, float]] = {
    "wall": (wall, "distance in metres", 0.05),
    "staircase": (staircase, "nearest distance in metres", 0.05),
    "tabletop": (tabletop, "seed", 0),
    "clutter": (clutter, "seed", 0),
    "room": (room, "seed", 0),
}  # name: (function, meaning of NUMBER in NAME:NUMBER, least number)


def named(name: str, number: str) -> Scene:
    """Build a builtin scene; `number` is the text after the colon, '' for the default.

    Raises:
        InputError: if the name is unknown, or the number is invalid or out of range.
    """
    errors.one_of("scene", name, BUILTIN)
    maker, meaning, _ = BUILTIN[name]
    if not number:
        return maker()
    try:
        value = float(number)
    except ValueError:
        raise errors.refuse(
            "scene", f"must be {name}:NUMBER", repr(f"{name}:{number}"), f"It is the {meaning}."
        ) from None
    refuse_number(name, value)
    return maker(value)


def refuse_number(name: str, value: float) -> None:
    """Refuse a number outside the range of a builtin scene, and seeds that are not whole.

    Raises:
        InputError: if the name is unknown, or the number is out of range.
    """
    errors.one_of("scene", name, BUILTIN)
    _, meaning, least = BUILTIN[name]
    errors.in_interval(f"{name}'s {meaning}", value, least, 2**31 if least == 0 else 50.0)
    if meaning == "seed" and value != int(value):
        raise errors.refuse(f"{name}'s seed", "must be whole", value, f"Give {int(value)}.")


def _on_table(
    name: str, seed: int, *, spots: tuple[int, int], spread_m: tuple[float, float], jitter: float
) -> Scene:
    """Place objects on a jittered grid, on a table 0.35 m below the camera."""
    rng = np.random.default_rng([seed, spots[0]])
    table_y, depth = 0.35, 1.05
    table, wall, floor = (
        solids.box((2.0, 0.04, 1.1)),
        solids.plane(12, 8),
        solids.box((12, 0.02, 8)),
    )
    bodies = [
        solids.body("table", table, materials.WOOD, frames.pose((0, table_y + 0.02, depth))),
        solids.body("wall", wall, materials.WALL_PAINT, frames.pose((0, 0, 2.2))),
        solids.body("floor", floor, materials.CARDBOARD, frames.pose((0, 1.1, 2.0))),
    ]
    cells = [(i, j) for j in range(spots[1]) for i in range(spots[0])]
    for number, (i, j) in enumerate(cells):
        x = (i - (spots[0] - 1) / 2 + rng.uniform(-jitter, jitter)) * spread_m[0]
        z = depth + (j - (spots[1] - 1) / 2 + rng.uniform(-jitter, jitter)) * spread_m[1]
        bodies += _object(number, np.array([x, table_y, z]), rng)
    tilted = frames.pose((0, -0.1, 0.2), (-24, 0, 0))  # The camera looks down at the table.
    return Scene(name=f"{name}:{seed}", bodies=tuple(bodies), world_from_left=tilted)


def _object(number: int, foot: np.ndarray, rng: np.random.Generator) -> list[Body]:
    """An object that stands on `foot`; kinds alternate, so that each scene has all of them."""
    size = rng.uniform(0.8, 1.25)
    turn = frames.pose((0, 0, 0), (0, rng.uniform(0, 360), 0))

    def pose_at(height: float) -> frames.Pose:
        return frames.pose(tuple(foot - _DOWN * height)) @ turn

    def placed(
        name: str,
        solid: trimesh.Trimesh,
        material: Material,
        height: float,
        *,
        upright: bool = False,
        smooth: bool = False,
    ) -> list[Body]:
        """One solid with its centre at a height above the foot."""
        pose = pose_at(height) @ _UPRIGHT if upright else pose_at(height)
        return [solids.body(f"{name} {number}", solid, material, pose, smooth=smooth)]

    kind = number % 8
    if kind == 0:
        h = 0.11 * size
        box = solids.box((0.12 * size, h, 0.08 * size))
        return placed("carton", box, materials.CARDBOARD, h / 2)
    if kind == 1:
        r = 0.05 * size
        return placed("ball", solids.sphere(r), materials.GLAZED_CERAMIC, r, smooth=True)
    if kind == 2:
        r, h = 0.033 * size, 0.12 * size
        can = solids.cylinder(r, h)
        return placed("can", can, materials.BRUSHED_STEEL, h / 2, upright=True)
    if kind == 3:
        h = 0.16 * size
        block = solids.box((0.06 * size, h, 0.06 * size))
        return placed("dark block", block, materials.CARBON_BLACK, h / 2)
    if kind == 4:
        return _plant(number, pose_at, size, rng)
    if kind == 5:
        r, h = 0.04 * size, 0.095 * size
        return placed("cup", solids.cup(r, h, 0.004), materials.PLASTIC, h / 2, upright=True)
    if kind == 6:
        r, tube = 0.05 * size, 0.012 * size
        ring = solids.ring(r, tube)
        return placed("ring", ring, materials.DARK_PLASTIC, tube, upright=True, smooth=True)
    r = 0.04 * size
    return placed("mirror ball", solids.sphere(r), materials.POLISHED_ALUMINIUM, r, smooth=True)


def _plant(
    number: int, pose_at: Callable[[float], frames.Pose], size: float, rng: np.random.Generator
) -> list[Body]:
    """Thin leaning rods in a pot, narrower than a matcher's window."""
    pot_height = 0.06 * size
    pot = solids.cylinder(0.035 * size, pot_height)
    rods = []
    for _ in range(7):
        length = rng.uniform(0.12, 0.2) * size
        lean = frames.pose((0, 0, 0), (rng.uniform(-25, 25), 0, rng.uniform(-25, 25)))
        rod = solids.cylinder(0.0025, length)
        rod.apply_transform(lean @ frames.pose((0, -length / 2, 0)) @ _UPRIGHT)
        rods.append(rod)
    stems = solids.join(rods)
    return [
        solids.body(f"pot {number}", pot, materials.RUBBER, pose_at(pot_height / 2) @ _UPRIGHT),
        solids.body(f"stems {number}", stems, materials.PAPER, pose_at(pot_height)),
    ]
