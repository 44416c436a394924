"""Check of GLB files: content that the mesh reader ignores, and buffers that are too short."""

from __future__ import annotations

import json
import struct
import warnings
from pathlib import Path
from typing import Any

from starling.patterns import errors, regular_file
from starling.sim import files
from starling.sim.scene import gltf_structure

# Extensions that change looks, lamps or notes, which Starling does not read from a mesh.
_LOOKS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_",
    "KHR_xmp",
)
_PLACES = {  # Keys whose numbers count or point.
    *("buffer", "bufferView", "byteLength", "byteOffset", "byteStride", "children", "count"),
    *("indices", "mesh", "nodes", "scene", "POSITION"),
}
_WIDTHS = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # Bytes of a component type.
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_KINDS = {  # Types and component types that the format allows.
    "POSITION": {("VEC3", 5126)},
    "indices": {("SCALAR", 5121), ("SCALAR", 5123), ("SCALAR", 5125)},
}
_LARGEST = 1e6  # Of a matrix: scales, and places in metres.
_FAN = 6  # Primitive mode of triangle fans.


def refuse_unsupported(path: Path) -> None:
    """Refuse a file whose geometry would be read wrongly; warn of skins and morph targets.

    Raises:
        ValueError: if the file is damaged or needs what is not supported; the message says how.
        OSError: if the file cannot be read.
    """
    data = regular_file.read(path)
    if data[:4] != b"glTF":
        raise ValueError("a GLB starts with glTF")
    (length,) = struct.unpack_from("<I", data, 12)
    header = files.parse_json(data[20 : 20 + length], path)
    _refuse_extensions(header)
    _refuse_negative(header)
    _refuse_cut(header, data[20 + length :])
    _refuse_short(header)
    _refuse_matrices(header)
    gltf_structure.refuse(header)
    primitives = [entry for mesh in header.get("meshes", []) for entry in mesh["primitives"]]
    for primitive in primitives:
        _refuse_primitive(primitive, header)
    kinds = {
        "skins": any("skin" in node for node in header.get("nodes", [])),
        "morph targets": any(primitive.get("targets") for primitive in primitives),
    }
    ignored = " and ".join(kind for kind, used in kinds.items() if used)
    if ignored:
        warnings.warn(f"{path}: {ignored} are not applied. Export the posed mesh.", stacklevel=2)
    for sentence in gltf_structure.ignored(header, _LOOKS, data[28 + length :]):
        warnings.warn(f"{path}: {sentence}.", stacklevel=2)


def _refuse_extensions(header: dict[str, Any]) -> None:
    required = header.get("extensionsRequired", [])
    unknown = [name for name in required if not name.startswith(_LOOKS)]
    if unknown:
        raise ValueError(f"it requires {', '.join(unknown)}, which is not supported")


def _refuse_negative(part: object, key: str = "") -> None:
    """Refuse truth values, and negative counts and places, which would count from the end."""
    if isinstance(part, dict):
        for name, value in part.items():
            if name not in ("extras", "extensions"):
                _refuse_negative(value, name)
    elif isinstance(part, list):
        for value in part:
            _refuse_negative(value, key)
    elif key in _PLACES and isinstance(part, int) and (isinstance(part, bool) or part < 0):
        raise ValueError(f"{key} is {json.dumps(part)}")


def _refuse_matrices(header: dict[str, Any]) -> None:
    """Refuse matrices that are not affine: the mesh reader ignores them."""
    for number, node in enumerate(header.get("nodes", [])):
        matrix = node.get("matrix")
        if matrix is None:
            continue
        whole = len(matrix) == 16 and all(errors.is_number(each) for each in matrix)
        if not whole or matrix[3::4] != [0, 0, 0, 1] or not max(map(abs, matrix)) <= _LARGEST:
            raise ValueError(f"the matrix of node {number} is not affine, or out of range")


def _refuse_cut(header: dict[str, Any], rest: bytes) -> None:
    """Refuse a buffer that is longer than the file's binary chunk."""
    for buffer in header.get("buffers", [])[:1]:
        held = max(len(rest) - 8, 0)  # The chunk's own header takes 8 bytes.
        if "uri" not in buffer and buffer["byteLength"] > held:
            raise ValueError(f"its buffer has {buffer['byteLength']} bytes, and {held} follow")


def _refuse_short(header: dict[str, Any]) -> None:
    """Refuse buffer views that leave their buffer, and accessors that leave their view."""
    views, buffers = header.get("bufferViews", []), header.get("buffers", [])
    for number, view in enumerate(views):
        end, size = view.get("byteOffset", 0) + view["byteLength"], _size(buffers, view, "buffer")
        if end > size:
            raise ValueError(f"buffer view {number} ends at byte {end} of {size}")
    for number, accessor in enumerate(header.get("accessors", [])):
        if "bufferView" not in accessor or not accessor["count"]:
            continue
        item = _WIDTHS[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
        size = _size(views, accessor, "bufferView")
        stride = views[accessor["bufferView"]].get("byteStride", item)
        if stride < item:
            raise ValueError(f"the byteStride of accessor {number} must be at least {item}")
        end = accessor.get("byteOffset", 0) + (accessor["count"] - 1) * stride + item
        if end > size:
            raise ValueError(f"accessor {number} ends at byte {end} of {size}")


def _size(parts: list[dict[str, Any]], entry: dict[str, Any], key: str) -> int:
    if entry[key] >= len(parts):
        raise ValueError(f"{key} {entry[key]} is missing")
    return parts[entry[key]]["byteLength"]


def _refuse_primitive(primitive: dict[str, Any], header: dict[str, Any]) -> None:
    if primitive.get("mode") == _FAN:
        raise ValueError("triangle fans are not supported; export triangles")
    positions = primitive["attributes"].get("POSITION")
    for name, place in (("POSITION", positions), ("indices", primitive.get("indices"))):
        if place is None:
            continue
        accessor = header["accessors"][place]
        kind = (accessor["type"], accessor["componentType"])
        if kind not in _KINDS[name]:
            raise ValueError(f"{name} must not be of type {kind[0]}, {kind[1]}")
        if "sparse" in accessor:
            raise ValueError(f"accessor {place} is sparse, which is not supported")
        if accessor.get("normalized"):
            raise ValueError(f"accessor {place} is normalized, which is not supported")
