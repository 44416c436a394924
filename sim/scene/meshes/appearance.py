"""Looks of a mesh file's surfaces as near-infrared materials and textures.

Files describe visible light. The near-infrared reflectance is `colours.near_infrared` of it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.scene import colours
from starling.sim.scene.meshes import atlas
from starling.sim.scene.scene import Body, Kind, Material, Mesh

LARGEST_PX = 4096  # Longest side of a texture; larger ones are reduced.
_METALLIC = 0.5  # Surfaces above this share are metal, as mixtures have no near-infrared model.
_GLOSSY_ALPHA = 0.25  # Roughest surface that has a gloss: roughness 0.5 in glTF's scale.
_FINEST_ALPHA = 0.01  # Smallest microfacet slope of `Material`.
_UNIT_LENGTH = 1e-3  # Tolerance of the length of vertex normals, as in `Mesh`.

Rgb = tuple[float, float, float]
UNKNOWN = Material(name="unnamed", reflectance=0.5)  # Surfaces of files without any colour.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Appearance:
    """Look of a surface in a file. Colours are visible reflectances in linear sRGB."""

    name: str = UNKNOWN.name
    rgb: Rgb | None = None  # Factor of the image or of vertex colours; None: the file has none.
    image: NDArray[np.uint8] | None = None  # (h, w, 3) sRGB; uv (0, 0) is the corner of [0, 0].
    metallic: float = 0.0  # In [0, 1].
    alpha: float = 1.0  # Microfacet slope (GGX).
    repeats: bool = True  # The image repeats outside uv of 0 to 1.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Part:
    """Triangles of one surface in a file, in the file's frame and unit."""

    name: str
    vertices: NDArray[np.float64]  # (n, 3)
    faces: NDArray[np.int64]  # (m, 3)
    normals: NDArray[np.float64] | None = None  # (n, 3)
    uv: NDArray[np.float64] | None = None  # (n, 2), v downwards in the image
    vertex_rgb: NDArray[np.float32] | None = None  # (n, 3) linear
    appearance: Appearance = dataclasses.field(default_factory=Appearance)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MeshFile:
    """Parts of a file in its own frame and unit."""

    parts: list[Part]
    unit_m: float = 1.0  # Metres in the file's unit.
    up: str = "y"  # Axis that points up: x, y or z.
    unused: frozenset[str] = frozenset()  # Content that is not used, in words.
    missing: tuple[str, ...] = ()  # Files that it names, and which do not exist.


def bodies(parts: list[Part], scale: float, origin: NDArray[np.float64]) -> tuple[Body, ...]:
    """Bodies of a file's parts.

    Args:
        parts: parts of a file; parts may share appearances.
        scale: metres in the file's unit.
        origin: (3,) point of the file that becomes the world's origin [m].
    """
    pictures: dict[int, tuple[Image, Image]] = {}
    return tuple(_body(part, scale, origin, pictures) for part in parts)


def _body(
    part: Part,
    scale: float,
    origin: NDArray[np.float64],
    pictures: dict[int, tuple[Image, Image]],
) -> Body:
    look, uv = part.appearance, part.uv
    vertices = (part.vertices * scale - origin).astype(np.float32)
    mesh = Mesh(vertices=vertices, faces=part.faces.astype(np.uint32), normals=_unit_normals(part))
    material = material_of(look, part.vertex_rgb)
    if look.image is not None and uv is not None:
        key = id(look)
        if key not in pictures:
            colour = colours.linear(look.image) * np.array(look.rgb or (1, 1, 1), np.float32)
            colour = np.minimum(colour, np.float32(1))
            pictures[key] = colour, colours.near_infrared(colour)
        colour, texture = pictures[key]
        mesh = dataclasses.replace(mesh, uv=uv.astype(np.float32))
        repeats = look.repeats
    elif part.vertex_rgb is not None and np.ptp(part.vertex_rgb, axis=0).any():
        tinted = part.vertex_rgb * np.array(look.rgb or (1, 1, 1), np.float32)
        mesh, colour = atlas.paint(mesh, tinted)
        texture, repeats = colours.near_infrared(colour), False
    else:
        return Body(name=part.name, mesh=mesh, material=material)
    return Body(
        name=part.name,
        mesh=mesh,
        material=material,
        texture=texture,
        colour=colour,
        repeats=repeats,
    )


def material_of(look: Appearance, vertex_rgb: NDArray[np.float32] | None = None) -> Material:
    """Material of a surface: metal above half metallic, glossy below roughness 0.5, or diffuse.

    Args:
        look: look in the file.
        vertex_rgb: (n, 3) colours of its vertices, linear.

    Returns:
        Material with the mean colour. `UNKNOWN` without any colour.
    """
    mean = np.ones(3, np.float32)
    if look.image is not None:
        mean = colours.linear(look.image).mean(axis=(0, 1))
    elif vertex_rgb is not None:
        mean = vertex_rgb.mean(axis=0)
    elif look.rgb is None:
        return dataclasses.replace(UNKNOWN, name=look.name)
    red, green, blue = np.clip(mean * np.array(look.rgb or (1, 1, 1), np.float32), 0, 1).tolist()
    kind: Kind = "diffuse"
    if look.metallic > _METALLIC:
        kind = "metal"
    elif look.alpha <= _GLOSSY_ALPHA:
        kind = "glossy"
    return Material(
        name=look.name,
        kind=kind,
        reflectance=float(colours.near_infrared(np.array([red, green, blue]))),
        roughness=float(np.clip(look.alpha, _FINEST_ALPHA, 1.0)),
        rgb=(red, green, blue),
    )


def alpha_of_shininess(exponent: float) -> float:
    """Microfacet slope whose lobe is as wide as that of a Blinn-Phong exponent.

    Source: Walter et al., Microfacet models for refraction, EGSR 2007, sec. 5.2.
    """
    return float(np.sqrt(2 / (max(exponent, 0.0) + 2)))


def reduced(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image (h, w, 3) with sides of at most `LARGEST_PX`."""
    height, width = image.shape[:2]
    scale = LARGEST_PX / max(height, width)
    if scale >= 1:
        return np.ascontiguousarray(image)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _unit_normals(part: Part) -> NDArray[np.float32] | None:
    """Normals of a part; None if a vertex of a triangle has none."""
    if part.normals is None:
        return None
    lengths = np.linalg.norm(part.normals, axis=1, keepdims=True)
    used = lengths[part.faces]
    if not (np.isfinite(used) & (used > _UNIT_LENGTH)).all():
        return None
    with np.errstate(all="ignore"):  # Unused vertices may have none.
        unit = part.normals / lengths
    return np.nan_to_num(unit).astype(np.float32)
