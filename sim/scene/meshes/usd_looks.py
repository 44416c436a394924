"""Looks of a USD stage: UsdPreviewSurface with its textures, and Omniverse's OmniPBR."""

from __future__ import annotations

import dataclasses
import importlib
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.scene.meshes.appearance import Appearance
from starling.sim.scene.meshes.trimesh_parts import picture

_UNUSED = {  # Inputs that change looks and are not used, if a texture gives them.
    "normal": "normal maps",
    "displacement": "displacement maps",
    "occlusion": "occlusion maps",
    "emissiveColor": "emission",
    "opacity": "transparency",
    "metallic": "maps of metal and roughness",
    "roughness": "maps of metal and roughness",
}


_MDL_NAME = "info:mdl:sourceAsset:subIdentifier"  # Attribute with the name of an MDL material.
_UNUSED_OMNIVERSE = {
    "normalmap_texture": "normal maps",
    "ao_texture": "occlusion maps",
    "enable_emission": "emission",
    "enable_opacity": "transparency",
    "metallic_texture": "maps of metal and roughness",
    "reflectionroughness_texture": "maps of metal and roughness",
    "ORM_texture": "maps of metal and roughness",
    "texture_scale": "scale of textures",
    "texture_rotate": "rotation of textures",
}
_EVEN = {"texture_scale": (1.0, 1.0), "texture_rotate": 0.0}  # Values that change nothing.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Look:
    """Appearance of a material, and where its texture lies."""

    appearance: Appearance = dataclasses.field(default_factory=Appearance)
    uv_name: str = "st"  # Name of the primvar with its coordinates.
    uv_scale: tuple[float, float] = (1.0, 1.0)
    uv_offset: tuple[float, float] = (0.0, 0.0)


_NONE = Look()


def pxr(name: str) -> Any:
    """Import a module of USD, whose functions type checkers do not see.

    Raises:
        ImportError: if usd-core is not installed.
    """
    return importlib.import_module(f"pxr.{name}")


class UsdLooks:
    """Looks of the materials of one stage, and what of them is not used."""

    def __init__(self) -> None:
        """Start without materials."""
        self._looks: dict[str, Look] = {}
        self.unused: set[str] = set()

    def of_prim(self, prim: Any) -> Look:
        """Look of the material that is bound to a prim."""
        UsdShade = pxr("UsdShade")

        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not material:
            return _NONE
        key = material.GetPath().pathString
        if key not in self._looks:
            self._looks[key] = self._read(material)
        return self._looks[key]

    def _read(self, material: Any) -> Look:
        shader, *_ = material.ComputeSurfaceSource()
        name = material.GetPrim().GetName()
        if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
            shader, *_ = material.ComputeSurfaceSource("mdl")
            kind = shader.GetPrim().GetAttribute(_MDL_NAME).Get() if shader else None
            if kind == "OmniPBR":
                return self._omniverse(name, shader)
            self.unused.add("materials other than UsdPreviewSurface and OmniPBR")
            return Look(appearance=Appearance(name=name))
        for key, words in _UNUSED.items():
            if self._source(shader, key) is not None:
                self.unused.add(words)
        if self._number(shader, "opacity", 1.0) < 1:
            self.unused.add("transparency")
        emission = self._value(shader, "emissiveColor")
        if emission is not None and any(emission):
            self.unused.add("emission")
        colour = self._value(shader, "diffuseColor")
        red, green, blue = np.clip([0.18] * 3 if colour is None else list(colour), 0, 1).tolist()
        look = Look(
            appearance=Appearance(
                name=name,
                rgb=(red, green, blue),
                metallic=self._number(shader, "metallic", 0.0),
                alpha=self._number(shader, "roughness", 0.5) ** 2,
            )
        )
        texture = self._source(shader, "diffuseColor")
        return look if texture is None else self._textured(look, texture)

    def _omniverse(self, name: str, shader: Any) -> Look:
        """Look of an OmniPBR, whose textures repeat."""
        for key, words in _UNUSED_OMNIVERSE.items():
            value = self._value(shader, key)
            if value is not None and value is not False and value != _EVEN.get(key):
                self.unused.add(words)
        asset, key = self._value(shader, "diffuse_texture"), "diffuse_color_constant"
        image = _image(asset)
        if image is not None:
            key = "diffuse_tint"
        elif asset is not None and asset.path:
            self.unused.add("textures that cannot be read")
        colour = self._value(shader, key)
        default = 0.2 if image is None else 1.0
        red, green, blue = np.clip(3 * [default] if colour is None else list(colour), 0, 1).tolist()
        appearance = Appearance(
            name=name,
            rgb=(red, green, blue),
            image=image,
            metallic=self._number(shader, "metallic_constant", 0.0),
            alpha=self._number(shader, "reflection_roughness_constant", 0.5) ** 2,
        )
        return Look(appearance=appearance)

    def _textured(self, look: Look, texture: Any) -> Look:
        """A look with the image of a UsdUVTexture; scale and bias are a factor."""
        image = _image(self._value(texture, "file"))
        if image is None:
            self.unused.add("textures that cannot be read")
            return look
        wraps = [str(self._value(texture, key) or "useMetadata") for key in ("wrapS", "wrapT")]
        scale = self._value(texture, "scale")
        red, green, blue = np.clip((1, 1, 1) if scale is None else list(scale)[:3], 0, 1).tolist()
        appearance = dataclasses.replace(
            look.appearance,
            rgb=(red, green, blue),
            image=image,
            repeats=any(wrap in ("repeat", "mirror") for wrap in wraps),
        )
        if "mirror" in wraps:
            self.unused.add("mirrored repetition of textures (they repeat)")
        return self._placed(dataclasses.replace(look, appearance=appearance), texture)

    def _placed(self, look: Look, texture: Any) -> Look:
        """A look with the name and transform of its texture coordinates."""
        reader = self._source(texture, "st")
        if reader is not None and reader.GetIdAttr().Get() == "UsdTransform2d":
            if self._number(reader, "rotation", 0.0):
                self.unused.add("rotation of textures")
            scale, offset = self._value(reader, "scale"), self._value(reader, "translation")
            look = dataclasses.replace(
                look,
                uv_scale=(1.0, 1.0) if scale is None else (float(scale[0]), float(scale[1])),
                uv_offset=(0.0, 0.0) if offset is None else (float(offset[0]), float(offset[1])),
            )
            reader = self._source(reader, "in")
        name = None if reader is None else self._value(reader, "varname")
        return look if name is None else dataclasses.replace(look, uv_name=str(name))

    def _source(self, shader: Any, name: str) -> Any:
        """Shader that an input is connected to; None without one."""
        UsdShade = pxr("UsdShade")

        entry = shader.GetInput(name)
        for attribute in entry.GetValueProducingAttributes() if entry else []:
            source = UsdShade.Shader(attribute.GetPrim())
            if source and UsdShade.Output.IsOutput(attribute):
                return source
        return None

    def _value(self, shader: Any, name: str) -> Any:
        """Value of an input, also through the interface of its material; None without one."""
        UsdShade = pxr("UsdShade")

        entry = shader.GetInput(name)
        for attribute in entry.GetValueProducingAttributes() if entry else []:
            if not UsdShade.Output.IsOutput(attribute):
                return attribute.Get()
        return None

    def _number(self, shader: Any, name: str, default: float) -> float:
        value = self._value(shader, name)
        return default if value is None else float(value)


def _image(asset: Any) -> NDArray[np.uint8] | None:
    """Picture of an asset, also inside a package; None if it is missing.

    Raises:
        ValueError: if it is no picture.
    """
    from PIL import Image

    Ar = pxr("Ar")
    if asset is None or not asset.resolvedPath:
        return None
    held = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath))
    if held is None:
        return None
    try:
        image = Image.open(io.BytesIO(bytes(held.GetBuffer())))
    except OSError as error:
        raise ValueError(f"{asset.path} is no picture: {error}") from error
    return picture(image)
