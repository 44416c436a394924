"""Random furniture and small objects of common sizes; each piece stands on y = 0, y down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import trimesh

from starling.sim.geometry import frames
from starling.sim.scene import materials
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material

Solid = trimesh.Trimesh
Rng = np.random.Generator

_UPRIGHT = frames.pose((0, 0, 0), (90, 0, 0))  # Turns a solid's z axis to the vertical.
_REFLECTANCE = (0.08, 0.85)  # Range for paints, cloths and woods.
_GLOSSY, _METAL, _BLACK = 0.25, 0.05, 0.08  # Shares of the parts with these materials.


@dataclass(frozen=True, slots=True, eq=False)
class FurniturePart:
    """A solid with one material."""

    name: str
    solid: Solid
    material: Material
    smooth: bool = False


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FurniturePiece:
    """Parts of one piece of furniture, and the radius of its footprint."""

    parts: tuple[FurniturePart, ...]
    radius_m: float


def draw_piece(rng: Rng) -> FurniturePiece:
    """Draw a random piece of furniture."""
    kind = _KINDS[int(rng.integers(len(_KINDS)))]
    parts = tuple(kind(rng))
    corners = np.concatenate([part.solid.vertices for part in parts])
    return FurniturePiece(parts=parts, radius_m=float(np.hypot(corners[:, 0], corners[:, 2]).max()))


def draw_material(rng: Rng) -> Material:
    """Draw a random material."""
    number = rng.random()
    if number < _METAL:
        return materials.BRUSHED_STEEL
    if number < _METAL + _BLACK:
        return materials.CARBON_BLACK
    low, high = _REFLECTANCE
    kind = "glossy" if rng.random() < _GLOSSY else "diffuse"
    reflectance = low * (high / low) ** float(rng.random())
    roughness = float(rng.uniform(0.08, 0.4))
    return Material(name="drawn", kind=kind, reflectance=reflectance, roughness=roughness)


def box(
    width_m: float, height_m: float, depth_m: float, *, foot: tuple[float, float, float]
) -> Solid:
    """Box whose bottom face is centred at `foot`."""
    x, y, z = foot
    solid = solids.box((width_m, height_m, depth_m))
    solid.apply_transform(frames.pose((x, y - height_m / 2, z)))
    return solid


def pole(radius_m: float, height_m: float, *, foot: tuple[float, float, float]) -> Solid:
    """Upright cylinder whose bottom face is centred at `foot`."""
    x, y, z = foot
    solid = trimesh.creation.cylinder(radius=radius_m, height=height_m, sections=32)
    solid.apply_transform(frames.pose((x, y - height_m / 2, z)) @ _UPRIGHT)
    return solid


def _table(rng: Rng) -> Iterator[FurniturePart]:
    width, depth = rng.uniform(0.5, 1.8), rng.uniform(0.45, 0.9)
    height, top = rng.uniform(0.45, 0.78), rng.uniform(0.02, 0.05)
    yield FurniturePart(
        "table top", box(width, top, depth, foot=(0, top - height, 0)), draw_material(rng)
    )
    yield FurniturePart(
        "table legs",
        _legs(width - 0.1, depth - 0.1, height - top, rng.uniform(0.012, 0.04)),
        draw_material(rng),
    )
    yield from _things(width, depth, -height, rng)


def _chair(rng: Rng) -> Iterator[FurniturePart]:
    side, seat, back = rng.uniform(0.38, 0.5), rng.uniform(0.4, 0.48), rng.uniform(0.35, 0.6)
    cloth = draw_material(rng)
    yield FurniturePart("chair seat", box(side, 0.04, side, foot=(0, 0.04 - seat, 0)), cloth)
    if rng.random() < 0.5:
        rest = box(side, back, 0.03, foot=(0, -seat, side / 2))
    else:  # A back of bars.
        count = int(rng.integers(3, 7))
        bars = np.linspace(-side / 2, side / 2, count)
        rest = solids.join([pole(0.01, back, foot=(float(x), -seat, side / 2)) for x in bars])
    yield FurniturePart("chair back", rest, cloth)
    legs = _legs(side - 0.05, side - 0.05, seat - 0.04, rng.uniform(0.01, 0.025))
    yield FurniturePart("chair legs", legs, draw_material(rng))


def _cabinet(rng: Rng) -> Iterator[FurniturePart]:
    width, height, depth = rng.uniform(0.4, 1.4), rng.uniform(0.5, 2.0), rng.uniform(0.3, 0.6)
    yield FurniturePart("cabinet", box(width, height, depth, foot=(0, 0, 0)), draw_material(rng))
    knobs = [
        box(0.02, 0.1, 0.03, foot=(x, -height / 2, -depth / 2)) for x in (-width / 8, width / 8)
    ]
    yield FurniturePart("cabinet handles", solids.join(knobs), draw_material(rng))
    yield from _things(width, depth, -height, rng)


def _shelf(rng: Rng) -> Iterator[FurniturePart]:
    width, height, depth = rng.uniform(0.5, 1.2), rng.uniform(0.8, 2.0), rng.uniform(0.22, 0.35)
    boards = int(rng.integers(3, 6))
    levels = np.linspace(0.05, height, boards)
    frame = [box(0.02, height, depth, foot=(x, 0, 0)) for x in (-width / 2, width / 2)]
    frame += [box(width, 0.02, depth, foot=(0, -float(level), 0)) for level in levels]
    if rng.random() < 0.5:
        frame.append(box(width, height, 0.01, foot=(0, 0, depth / 2)))
    yield FurniturePart("shelf", solids.join(frame), draw_material(rng))
    gap = float(levels[1] - levels[0])
    for level in levels[:-1]:
        x = -width / 2 + 0.03
        while x < width / 2 - 0.06 and rng.random() < 0.93:
            thick, tall = rng.uniform(0.015, 0.06), gap * rng.uniform(0.5, 0.85)
            deep = depth * rng.uniform(0.5, 0.9)
            foot = (x + thick / 2, -float(level) - 0.02, 0.0)
            yield FurniturePart("book", box(thick, tall, deep, foot=foot), draw_material(rng))
            x += thick + (0.0 if rng.random() < 0.8 else float(rng.uniform(0.02, 0.2)))


def _sofa(rng: Rng) -> Iterator[FurniturePart]:
    width, seat, depth = rng.uniform(0.8, 2.0), rng.uniform(0.35, 0.45), rng.uniform(0.7, 0.95)
    cloth = draw_material(rng)
    arm, back = rng.uniform(0.1, 0.2), rng.uniform(0.3, 0.5)
    body = [
        box(width, seat, depth, foot=(0, 0, 0)),
        box(width, back, 0.2, foot=(0, -seat, depth / 2 - 0.1)),
        *(box(arm, seat + 0.18, depth, foot=(x, 0, 0)) for x in (-width / 2, width / 2)),
    ]
    yield FurniturePart("sofa", solids.join(body), cloth)
    for _ in range(int(rng.integers(0, 4))):
        pillow = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
        pillow.apply_scale((rng.uniform(0.18, 0.28), rng.uniform(0.15, 0.22), 0.09))
        place = (float(rng.uniform(-0.4, 0.4)) * width, -seat - 0.15, depth / 2 - 0.28)
        pillow.apply_transform(frames.pose(place, (float(rng.uniform(-25, 0)), 0, 0)))
        yield FurniturePart("pillow", pillow, draw_material(rng), smooth=True)


def _lamp(rng: Rng) -> Iterator[FurniturePart]:
    height, wide = rng.uniform(1.1, 1.8), rng.uniform(0.12, 0.25)
    stand = [pole(0.012, height, foot=(0, 0, 0)), pole(0.14, 0.02, foot=(0, 0, 0))]
    yield FurniturePart("lamp stand", solids.join(stand), draw_material(rng))
    tall = rng.uniform(0.2, 0.35)
    shade = solids.cup(wide, tall, 0.004)
    shade.apply_transform(frames.pose((0, -height, 0)) @ _UPRIGHT)
    yield FurniturePart("lamp shade", shade, draw_material(rng))


def _plant(rng: Rng) -> Iterator[FurniturePart]:
    pot, wide = rng.uniform(0.15, 0.4), rng.uniform(0.1, 0.2)
    yield FurniturePart("pot", pole(wide, pot, foot=(0, 0, 0)), draw_material(rng))
    leaves = []
    tall, reach = rng.uniform(0.3, 1.2), rng.uniform(0.15, 0.4)
    for _ in range(int(rng.integers(25, 80))):
        long = float(rng.uniform(0.06, 0.22))
        leaf = solids.plane(long * rng.uniform(0.2, 0.5), long)
        turn = tuple(float(angle) for angle in rng.uniform(-80, 80, 3))
        angle, away = rng.uniform(0, 2 * np.pi), reach * np.sqrt(rng.random())
        x, z = float(away * np.cos(angle)), float(away * np.sin(angle))
        place = (x, -pot - tall * float(rng.random()), z)
        leaf.apply_transform(frames.pose(place, (turn[0], turn[1], turn[2])))
        leaves.append(leaf)
    stem = pole(0.008, pot + tall, foot=(0, 0, 0))
    yield FurniturePart("plant", solids.join([stem, *leaves]), materials.named("leaf"))


def _cartons(rng: Rng) -> Iterator[FurniturePart]:
    level = 0.0
    for _ in range(int(rng.integers(1, 5))):
        width, height, depth = rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.4), rng.uniform(0.2, 0.5)
        carton = box(width, height, depth, foot=(0, 0, 0))
        turn = (0, float(rng.uniform(-20, 20)), 0)
        carton.apply_transform(frames.pose((0, -level, 0), turn))
        yield FurniturePart("carton", carton, draw_material(rng))
        level += height


def _bin(rng: Rng) -> Iterator[FurniturePart]:
    wide, height = rng.uniform(0.1, 0.2), rng.uniform(0.25, 0.6)
    solid = solids.cup(wide, height, 0.01)
    solid.apply_transform(frames.pose((0, -height / 2, 0)) @ _UPRIGHT)
    yield FurniturePart("bin", solid, draw_material(rng))


def _ladder(rng: Rng) -> Iterator[FurniturePart]:
    """Parallel rods, as of a radiator, rack or crib."""
    width, height = rng.uniform(0.4, 1.2), rng.uniform(0.5, 1.4)
    thick, count = rng.uniform(0.006, 0.03), int(rng.integers(5, 16))
    rods = [
        pole(thick, height, foot=(float(x), 0, 0)) for x in np.linspace(-0.5, 0.5, count) * width
    ]
    rails = [box(width, 0.03, 0.03, foot=(0, -level, 0)) for level in (0.1, height - 0.05)]
    yield FurniturePart("rods", solids.join(rods + rails), draw_material(rng))


def _legs(width: float, depth: float, height: float, thick: float) -> Solid:
    places = [(x, z) for x in (-width / 2, width / 2) for z in (-depth / 2, depth / 2)]
    return solids.join([pole(thick, height, foot=(x, 0, z)) for x, z in places])


def _things(width: float, depth: float, level: float, rng: Rng) -> Iterator[FurniturePart]:
    """Small objects on a surface at height `level`."""
    for _ in range(int(rng.integers(0, 8))):
        x, z = rng.uniform(-0.42, 0.42) * width, rng.uniform(-0.42, 0.42) * depth
        foot, size = (float(x), level, float(z)), float(rng.uniform(0.04, 0.16))
        number = rng.random()
        if number < 0.4:
            thing = box(
                size * rng.uniform(0.5, 2), size, size * rng.uniform(0.4, 1), foot=(0, 0, 0)
            )
            thing.apply_transform(frames.pose(foot, (0, float(rng.uniform(0, 360)), 0)))
        elif number < 0.7:
            thing = pole(size / 3, size * 1.5, foot=foot)
        elif number < 0.85:
            thing = trimesh.creation.icosphere(subdivisions=3, radius=size / 2)
            thing.apply_transform(frames.pose((foot[0], level - size / 2, foot[2])))
        else:  # A screen on a foot.
            screen = box(4 * size, 2.4 * size, 0.02, foot=(foot[0], level - 0.08, foot[2]))
            thing = solids.join([screen, pole(0.02, 0.1, foot=foot)])
        yield FurniturePart("thing", thing, draw_material(rng), smooth=0.7 <= number < 0.85)


_KINDS: tuple[Callable[[Rng], Iterator[FurniturePart]], ...] = (
    _table,
    _table,
    _chair,
    _chair,
    _cabinet,
    _shelf,
    _sofa,
    _lamp,
    _plant,
    _cartons,
    _bin,
    _ladder,
)
