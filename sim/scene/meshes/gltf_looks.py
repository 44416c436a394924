"""Looks of a GLB file: base colour, metal, roughness and wrap mode of its materials.

The mesh reader rounds factors to bytes and drops samplers, so they are read from the header.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.scene.meshes.appearance import Appearance, Part
from starling.sim.scene.meshes.trimesh_parts import picture

_REPEAT, _MIRRORED = 10497, 33648  # Wrap modes of samplers; repeat is the default.
_TRANSFORM = "KHR_texture_transform"
_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
_UNUSED = {  # Entries of materials that change looks, and are not used.
    "normalTexture": "normal maps",
    "occlusionTexture": "occlusion maps",
    "emissiveTexture": "emission",
}


class GltfLooks:
    """Appearances of the materials of one file, and what of them is not used."""

    def __init__(self, header: dict[str, Any]) -> None:
        """Keep the header of a file."""
        self._header = header
        self._appearances: dict[int, Appearance] = {}
        self._moves: dict[int, tuple[list[float], list[float]]] = {}
        self.unused = _unused(header)

    def look(self, material: Any) -> Appearance:
        """Appearance of a material that the reader made of `numbered` data."""
        number = int(material.name)
        if number not in self._appearances:
            self._appearances[number] = self._read(number, material)
        return self._appearances[number]

    def adapted(self, part: Part) -> Part:
        """A part with the offset and scale of its texture, and without unused colours."""
        look = part.appearance
        number = next((key for key, each in self._appearances.items() if each is look), None)
        if part.uv is not None and number in self._moves:
            scale, offset = self._moves[number]
            part = replace(part, uv=part.uv * scale + offset)
        if look.image is not None and part.uv is None:
            self.unused.add("textures without coordinates")
        if look.image is not None and part.vertex_rgb is not None:
            if (part.vertex_rgb < 1).any():
                self.unused.add("vertex colours of textured surfaces")
            part = replace(part, vertex_rgb=None)
        return part

    def _read(self, number: int, material: Any) -> Appearance:
        entry = self._header["materials"][number]
        name = str(entry.get("name") or f"material {number}")
        if _GLOSSINESS in entry.get("extensions", {}):
            return _converted(name, material)
        pbr = entry.get("pbrMetallicRoughness", {})
        if not pbr:
            return Appearance(name=name)
        red, green, blue = np.clip(pbr.get("baseColorFactor", [1.0] * 4)[:3], 0, 1).tolist()
        metallic, roughness = pbr.get("metallicFactor", 1.0), pbr.get("roughnessFactor", 1.0)
        if "metallicRoughnessTexture" in pbr and material.metallicRoughnessTexture is not None:
            self.unused.add("maps of metal and roughness (their mean is)")
            means = picture(material.metallicRoughnessTexture).mean(axis=(0, 1)) / 255
            roughness, metallic = roughness * means[1], metallic * means[2]
        image, repeats = self._image(number, pbr.get("baseColorTexture"), material)
        return Appearance(
            name=name,
            rgb=(red, green, blue),
            image=image,
            metallic=float(metallic),
            alpha=float(roughness) ** 2,
            repeats=repeats,
        )

    def _image(
        self, number: int, entry: dict[str, Any] | None, material: Any
    ) -> tuple[NDArray[np.uint8] | None, bool]:
        """Image of the base colour, and whether it repeats."""
        if entry is None:
            return None, True
        if material.baseColorTexture is None:
            self.unused.add("textures that cannot be read")
            return None, True
        image = picture(material.baseColorTexture)
        move = entry.get("extensions", {}).get(_TRANSFORM, {})
        if entry.get("texCoord", 0) or move.get("texCoord", 0) or move.get("rotation", 0):
            self.unused.add("second texture coordinates and turned textures (mean colours are)")
            return np.rint(image.mean(axis=(0, 1), keepdims=True)).astype(np.uint8), True
        scale, offset = list(move.get("scale", [1, 1])), list(move.get("offset", [0, 0]))
        texture = self._header["textures"][entry["index"]]
        sampler = self._header["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wraps = [sampler.get(key, _REPEAT) for key in ("wrapS", "wrapT")]
        for axis, wrap in enumerate(wraps):
            if wrap == _MIRRORED:
                image = np.concatenate([image, np.flip(image, 1 - axis)], axis=1 - axis)
                scale[axis], offset[axis] = scale[axis] / 2, offset[axis] / 2
        if (scale, offset) != ([1, 1], [0, 0]):
            self._moves[number] = scale, offset
        repeating = [wrap in (_REPEAT, _MIRRORED) for wrap in wraps]
        if repeating[0] != repeating[1]:
            self.unused.add("clamping of textures along one axis")
        return image, any(repeating)


def numbered(data: bytes) -> tuple[bytes, dict[str, Any]]:
    """GLB whose materials have their number as name, and its header before the change.

    Args:
        data: GLB that `gltf.refuse_unsupported` accepts.
    """
    (length,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + length])
    materials = [{**each, "name": str(n)} for n, each in enumerate(header.get("materials", []))]
    text = json.dumps({**header, "materials": materials} if materials else header).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk, header


def linear_bytes(levels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Linear light of vertex colours, which glTF stores without the sRGB curve."""
    return levels.astype(np.float32) / np.float32(255)


def _converted(name: str, material: Any) -> Appearance:
    """Appearance of a glossiness material, which the reader converts."""
    factor, image = material.baseColorFactor, material.baseColorTexture
    share = [1.0, 1.0, 1.0] if factor is None else (np.asarray(factor)[:3] / 255).tolist()
    roughness = 1.0 if material.roughnessFactor is None else float(material.roughnessFactor)
    return Appearance(
        name=name,
        rgb=(share[0], share[1], share[2]),
        image=None if image is None else picture(image),
        metallic=float(material.metallicFactor or 0.0),
        alpha=roughness**2,
    )


def _unused(header: dict[str, Any]) -> set[str]:
    unused: set[str] = set()
    for material in header.get("materials", []):
        unused |= {words for key, words in _UNUSED.items() if key in material}
        if any(material.get("emissiveFactor", [])):
            unused.add("emission")
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            unused.add("transparency")
        unused |= {name for name in material.get("extensions", {}) if name != _GLOSSINESS}
    extensions = header.get("extensions", {})
    if any("light" in name for name in extensions):
        unused.add("lights")
    if header.get("cameras"):
        unused.add("cameras")
    if header.get("animations"):
        unused.add("animations")
    return unused
