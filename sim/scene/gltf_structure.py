"""Check of the nodes, materials and bounds of a glTF header. Source: glTF 2.0, chapters 3 and 5."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from starling.patterns import errors

_LENGTH = 0.01  # Largest departure of a rotation's length from 1.
_BOUNDS = 1e-3  # Largest departure of stated bounds from the vertices, as a share of the extent.
_FACTORS = ("baseColorFactor", "metallicFactor", "roughnessFactor")


def refuse(header: dict[str, Any]) -> None:
    """Refuse nodes that form no tree, rotations that are none, and colours outside [0, 1].

    Raises:
        ValueError: if the header has them; the message says which.
    """
    _refuse_graph(header)
    for number, node in enumerate(header.get("nodes", [])):
        rotation = node.get("rotation", [0, 0, 0, 1])
        whole = len(rotation) == 4 and all(errors.is_number(each) for each in rotation)
        if not whole or not abs(math.hypot(*rotation) - 1) <= _LENGTH:
            raise ValueError(f"the rotation of node {number} must have the length 1")
    for number, material in enumerate(header.get("materials", [])):
        surface = material.get("pbrMetallicRoughness", {})
        for name in _FACTORS:
            values = surface.get(name, 1.0)
            for value in values if isinstance(values, list) else [values]:
                errors.in_interval(f"{name} of material {number}", value, 0.0, 1.0)


def ignored(header: dict[str, Any], known: tuple[str, ...], binary: bytes) -> Iterator[str]:
    """Yield a sentence on each part that is not used, or contradicts another.

    Args:
        header: header that `refuse` accepts.
        known: starts of the names of extensions that change looks only.
        binary: binary chunk without its own header.
    """
    nodes = header.get("nodes", [])
    used = {name for node in nodes for name in node.get("extensions", {})}
    unknown = sorted(name for name in used if not name.startswith(known))
    if unknown:
        yield f"{', '.join(unknown)} is not applied. Export the meshes without it"
    for number in sorted(_positions(header)):
        if _contradicts(header, number, binary):
            yield f"the vertices of accessor {number} lie outside its min and max"


def _refuse_graph(header: dict[str, Any]) -> None:
    nodes = header.get("nodes", [])
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if child in parents or not 0 <= child < len(nodes):
                rule = "has two parents" if child in parents else "is missing"
                raise ValueError(f"node {child} {rule}")
            parents[child] = number
    below_root: set[int] = set()
    for number in parents:
        way: set[int] = set()
        while number in parents and number not in below_root:
            if number in way:
                raise ValueError(f"node {number} is above itself")
            way.add(number)
            number = parents[number]
        below_root.update(way)
    for scene in header.get("scenes", []):
        roots = scene.get("nodes", [])
        for root in roots:
            if root >= len(nodes):
                raise ValueError(f"node {root} is missing")
            if root in parents or roots.count(root) > 1:
                raise ValueError(f"node {root} is in a scene twice")


def _positions(header: dict[str, Any]) -> set[int]:
    return {
        primitive["attributes"]["POSITION"]
        for mesh in header.get("meshes", [])
        for primitive in mesh["primitives"]
        if "POSITION" in primitive["attributes"]
    }


def _contradicts(header: dict[str, Any], number: int, binary: bytes) -> bool:
    """Return whether vertices in the binary chunk lie outside the bounds of their accessor."""
    accessor = header["accessors"][number]
    bounds = [accessor.get(key, []) for key in ("min", "max")]
    if "bufferView" not in accessor or not accessor["count"] or [*map(len, bounds)] != [3, 3]:
        return False
    view = header["bufferViews"][accessor["bufferView"]]
    if view["buffer"] or "uri" in header["buffers"][0]:
        return False
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    shape, stride = (accessor["count"], 3), view.get("byteStride", 12)
    vertices = np.ndarray(shape, "<f4", binary, start, (stride, 4)).astype(np.float64)
    low, high = np.array(bounds, np.float64)
    allowed = _BOUNDS * max(float((high - low).max()), 0.0) + 1e-6 * float(np.abs(vertices).max())
    outside = (vertices < low - allowed) | (vertices > high + allowed)
    return bool(outside.any())
