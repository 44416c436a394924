"""Meshes of URDFs that MuJoCo does not read: COLLADA, GLB and PLY."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import trimesh

from starling.sim.scene import colours
from starling.sim.scene.meshes import mesh_file
from starling.sim.scene.meshes.appearance import Part

_SUFFIXES = (".dae", ".glb", ".ply")
_UNKNOWN = 0.5  # Level of MuJoCo's own grey, for surfaces without a colour.


def converted(robot: ElementTree.Element) -> dict[str, bytes]:
    """Replace each such mesh of a robot by one STL for each of its surfaces.

    A surface keeps its colour if the URDF gives none; textures are replaced by their mean. The
    axes are those of the file, as in RViz.

    Args:
        robot: root of a URDF with absolute file names; changed in place.

    Returns:
        Content of the STL files by their names.

    Raises:
        InputError: if a mesh is unreadable, or its reader is not installed.
    """
    files: dict[str, bytes] = {}
    for link in robot.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            path = Path("" if mesh is None else mesh.attrib["filename"])
            if path.suffix.lower() not in _SUFFIXES or not path.is_file():
                continue
            link.remove(shape)
            content = mesh_file.read(path)
            for part in content.parts:
                name = f"surface-{len(files)}.stl"
                files[name] = _stl(part, content.unit_m)
                link.append(_shape(shape, name, part))
    return files


def _stl(part: Part, unit_m: float) -> bytes:
    mesh = trimesh.Trimesh(part.vertices * unit_m, part.faces, process=False)
    content = mesh.export(file_type="stl")
    assert isinstance(content, bytes)
    return content


def _shape(shape: ElementTree.Element, name: str, part: Part) -> ElementTree.Element:
    """Copy of a visual or collision element with one surface."""
    surface = copy.deepcopy(shape)
    for mesh in surface.iter("mesh"):
        mesh.attrib["filename"] = name
    if surface.tag == "visual" and surface.find("material") is None:
        material = ElementTree.SubElement(surface, "material", name=name)
        rgba = " ".join(f"{level:.4f}" for level in (*_srgb(part), 1.0))
        ElementTree.SubElement(material, "color", rgba=rgba)
    return surface


def _srgb(part: Part) -> list[float]:
    """Mean colour of a surface in sRGB (IEC 61966-2-1), in [0, 1]."""
    look = part.appearance
    if look.rgb is None and look.image is None and part.vertex_rgb is None:
        return [_UNKNOWN] * 3
    rgb = np.ones(3) if look.rgb is None else np.array(look.rgb)
    if look.image is not None:
        rgb = rgb * colours.linear(look.image).mean((0, 1))
    if part.vertex_rgb is not None:
        rgb = rgb * part.vertex_rgb.mean(0)
    curved = 1.055 * np.maximum(rgb, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(rgb <= 0.0031308, 12.92 * rgb, curved).clip(0, 1).tolist()
