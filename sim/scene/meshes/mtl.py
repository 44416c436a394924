"""Looks of an OBJ file: the materials of its MTL.

Numbers are linear, as Blender writes them; images are sRGB. `Ns` gives roughness where a material
has specular light `Ks`. `Pr` and `Pm`, of the extension for physically based materials, precede it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from starling.patterns import regular_file
from starling.sim.scene.meshes.appearance import Appearance, alpha_of_shininess
from starling.sim.scene.meshes.trimesh_parts import picture

_COLOURS = ("kd", "map_kd", "pm", "pr", "ks")  # Keys of materials that have a look.
_UNUSED = {
    "normal maps": ("map_bump", "bump", "norm", "map_kn"),
    "displacement maps": ("disp", "map_disp"),
    "emission": ("map_ke",),
    "transparency": ("map_d", "map_tr"),
    "maps of gloss": ("map_ks", "map_ns", "map_pr", "map_pm", "map_ps"),
    "reflection maps": ("refl",),
    "ambient maps": ("map_ka",),
}


_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_VALUE = rb"(?:on|off|[rgbmlz]|[-+]?[0-9.]+(?:e[-+]?[0-9]+)?)"
# Options of `map_Kd` precede the file (Wavefront's MTL). The reader takes them for its name.
_OPTIONS = re.compile(
    rb"^([ \t]*map_kd)((?:[ \t]+-[a-z]+(?:[ \t]+%b(?=[ \t]))*)+)" % _VALUE, re.M | re.I
)
_MOVED = re.compile(rb"-[ost][ \t]", re.I)  # Offset, scale and turbulence.


def plain(data: bytes) -> bytes:
    """Return an OBJ or MTL without byte order mark and without options of `map_Kd`."""
    return _OPTIONS.sub(rb"\1", data.removeprefix(_BYTE_ORDER_MARK))


class MtlLooks:
    """Appearances of the materials of one OBJ file, and what of them is not used."""

    def __init__(self) -> None:
        """Start without materials."""
        self._appearances: dict[int, Appearance] = {}
        self._kept: list[Any] = []  # Materials stay alive, so that their ids stay unique.
        self.unused: set[str] = set()
        self.names: set[str] = set()  # Of materials that the reader has read.

    def look(self, material: Any) -> Appearance:
        """Appearance of a material of the reader."""
        kwargs: dict[str, Any] = getattr(material, "kwargs", {})
        name = str(getattr(material, "name", None) or Appearance().name)
        self.names.add(name)
        image = getattr(material, "image", None)
        if getattr(image, "format", None) is None:
            image = None  # The reader's own picture for surfaces without a material.
        if image is None and not any(key in kwargs for key in _COLOURS):
            return Appearance(name=name)
        key = id(material)
        if key not in self._appearances:
            self._kept.append(material)
            self._appearances[key] = self._read(name, image, kwargs)
        return self._appearances[key]

    def _read(self, name: str, image: Any, kwargs: dict[str, Any]) -> Appearance:
        for words, keys in _UNUSED.items():
            if any(key in kwargs for key in keys):
                self.unused.add(words)
        if any(_numbers(kwargs.get("ke", []))):
            self.unused.add("emission")
        if any(value < 1 for value in _numbers(kwargs.get("d", []))) or any(
            _numbers(kwargs.get("tr", []))
        ):
            self.unused.add("transparency")
        red, green, blue = np.clip(_triple(kwargs.get("kd", [])), 0, 1).tolist()
        rough, metal = _numbers(kwargs.get("pr", [])), _numbers(kwargs.get("pm", []))
        alpha = 1.0
        if rough:
            alpha = rough[0] ** 2
        elif any(_numbers(kwargs.get("ks", []))):
            alpha = alpha_of_shininess(*(_numbers(kwargs.get("ns", [])) or [0.0])[:1])
        return Appearance(
            name=name,
            rgb=(red, green, blue),
            image=None if image is None else picture(image),
            metallic=metal[0] if metal else 0.0,
            alpha=alpha,
        )


def missing_files(path: Path) -> list[str]:
    """Material files that an OBJ names, and textures that these name, which do not exist."""
    missing: list[str] = []
    for name in _named(path, "mtllib"):
        file = path.parent / name
        if not file.is_file():
            missing.append(name)
            continue
        for texture in _named(file, "map_Kd"):
            if not (path.parent / texture).is_file():
                missing.append(texture)
    return missing


def unread_files(path: Path) -> list[str]:
    """Textures of the materials of an OBJ that exist, but are no pictures."""
    names = [name for file in _material_files(path) for name in _named(file, "map_Kd")]
    existing = [name for name in names if (path.parent / name).is_file()]
    return [name for name in existing if not _is_picture(path.parent / name)]


def moves_textures(path: Path) -> bool:
    """Whether a material of an OBJ moves, scales or disturbs its texture, which is not done."""
    texts = map(regular_file.read, _material_files(path))
    return any(_MOVED.search(options[2]) for text in texts for options in _OPTIONS.finditer(text))


def _material_files(path: Path) -> list[Path]:
    """Material files that an OBJ names and that exist."""
    files = [path.parent / name for name in _named(path, "mtllib")]
    return [file for file in files if file.is_file()]


def _is_picture(path: Path) -> bool:
    try:
        PIL.Image.open(path).close()
    except Exception:  # Pillow raises errors of any type.
        return False
    return True


def used_materials(path: Path) -> set[str]:
    """Names of the materials of an OBJ that have faces; none without a material file."""
    if not _material_files(path):
        return set()
    names: set[str] = set()
    name = ""
    for line in regular_file.read(path).decode("utf-8", errors="replace").splitlines():
        if line.startswith("usemtl"):
            name = line.removeprefix("usemtl").strip()
        elif name and line.startswith("f "):
            names.add(name)
            name = ""
    return names


def _named(path: Path, keyword: str) -> list[str]:
    """Rest of each line that starts with a keyword."""
    text = plain(regular_file.read(path)).decode("utf-8", errors="replace")
    lines = re.findall(rf"^[ \t]*{keyword}[ \t]+(\S.*?)[ \t\r]*$", text, re.M | re.I)
    return list(dict.fromkeys(lines))


def _numbers(value: Any) -> list[float]:
    """Numbers of an entry; none if it holds other words."""
    try:
        return [float(each) for each in (value if isinstance(value, list) else [value])]
    except ValueError:
        return []


def _triple(value: Any) -> list[float]:
    """Three numbers; one number is grey, and none is white."""
    numbers = [number for number in _numbers(value) if np.isfinite(number)]
    return numbers[:3] if len(numbers) >= 3 else 3 * (numbers[:1] or [1.0])
