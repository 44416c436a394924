"""Parts of a file that trimesh has read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.sim.scene import colours
from starling.sim.scene.meshes.appearance import Appearance, Part, reduced

Look = Callable[[Any], Appearance]  # Appearance of a material of trimesh.
Encoding = Callable[[NDArray[np.uint8]], NDArray[np.float32]]  # Linear light of vertex colours.


def parts(loaded: trimesh.Scene, look: Look, encoding: Encoding = colours.linear) -> list[Part]:
    """Parts of a loaded file, moved to their places.

    Args:
        loaded: scene of trimesh.
        look: appearance of a material of trimesh; equal objects for equal materials.
        encoding: linear light of the bytes of vertex colours; sRGB by default.

    Raises:
        ValueError: if a triangle has a vertex that is missing, or vertices are not in space.
    """
    listed: list[Part] = []
    for node in loaded.graph.nodes_geometry:
        world_from_mesh, name = loaded.graph.get(node)
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            if not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
                raise ValueError("a triangle has a vertex that is missing")
            listed.append(_part(str(name), mesh, world_from_mesh, look, encoding))
    return listed


def picture(image: Any) -> NDArray[np.uint8]:
    """Bytes (h, w, 3) of a picture of Pillow.

    Raises:
        ValueError: if the picture cannot be read.
    """
    try:
        if image.mode.startswith("I"):  # Pillow cuts 16 bits instead of dividing.
            grey = np.asarray(image, np.int64)
            levels = np.clip(grey >> 8, 0, 255).astype(np.uint8)
            return reduced(np.repeat(levels[..., None], 3, axis=2))
        if image.mode == "F":
            raise ValueError("it holds floating-point numbers; save 8 bits")
        return reduced(np.asarray(image.convert("RGB"), np.uint8))
    except Exception as error:  # Pillow raises errors of any type.
        raise ValueError(f"a texture cannot be read: {error}") from error


def _part(
    name: str,
    mesh: trimesh.Trimesh,
    world_from_mesh: NDArray[np.float64],
    look: Look,
    encoding: Encoding,
) -> Part:
    # The cache has the file's normals.
    if mesh.vertices.shape[1] != 3:
        raise ValueError(f"its vertices have {mesh.vertices.shape[1]} coordinates")
    held = mesh.copy(include_cache=True, include_visual=False)
    held.apply_transform(world_from_mesh)
    vertices, faces = np.asarray(held.vertices), np.asarray(held.faces)
    normals = np.array(held.vertex_normals) if "vertex_normals" in held._cache else None
    uv: NDArray[np.float64] | None = None
    colour: NDArray[np.uint8] | None = None
    appearance = Appearance()
    visual: Any = mesh.visual
    if visual.kind == "texture":
        appearance = look(visual.material)
        if visual.uv is not None and np.shape(visual.uv) == (len(vertices), 2):
            uv = np.array(visual.uv, np.float64)
            uv[:, 1] = 1 - uv[:, 1]  # The reader has v upwards.
        # Colours that a material multiplies.
        colour = visual.vertex_attributes.get("color", mesh.vertex_attributes.get("color"))
    elif visual.kind == "vertex":
        colour = np.asarray(visual.vertex_colors)
    elif visual.kind == "face":
        colour = np.repeat(np.asarray(visual.face_colors), 3, axis=0)
        vertices = vertices[faces.ravel()]
        normals = None if normals is None else normals[faces.ravel()]
        faces = np.arange(len(vertices)).reshape(-1, 3)
    return Part(
        name=name,
        vertices=vertices,
        faces=faces,
        normals=normals,
        uv=uv,
        vertex_rgb=None if colour is None else _linear(np.asarray(colour), encoding),
        appearance=appearance,
    )


def _linear(colour: NDArray[Any], encoding: Encoding) -> NDArray[np.float32]:
    """Linear light (n, 3) of vertex colours in bytes, 16-bit integers or shares of 1."""
    colour = colour[:, :3]
    if colour.dtype.kind == "f":
        colour = np.rint(255 * np.clip(np.nan_to_num(colour), 0, 1)).astype(np.uint8)
    elif colour.dtype == np.uint16:
        colour = (colour >> 8).astype(np.uint8)
    return encoding(colour.astype(np.uint8))
