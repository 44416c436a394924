"""Looks, unit and up axis of a COLLADA file (.dae)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors, regular_file
from starling.sim.scene.meshes.appearance import Appearance
from starling.sim.scene.meshes.trimesh_parts import picture

_AXES = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
_UNUSED = {"light": "lights", "camera": "cameras", "bump": "normal maps", "skin": "skins"}


def refuse_without_reader() -> None:
    """Refuse the file if pycollada is not installed.

    Raises:
        InputError: if it is not.
    """
    try:
        import collada  # noqa: F401
    except ImportError as error:
        raise errors.needs("DAE", "pycollada", "scenes") from error


class ColladaLooks:
    """Appearances of the materials of one file, its frame, and what is not used."""

    def __init__(self, path: Path) -> None:
        """Read unit, up axis and the names of all elements.

        Raises:
            ValueError: if the file is no XML, or its unit is no positive number.
            OSError: if the file cannot be read.
        """
        try:
            root = ElementTree.fromstring(regular_file.read(path))
        except ElementTree.ParseError as error:
            raise ValueError(f"it is no XML: {error}") from error
        elements = {element.tag.rpartition("}")[2]: element for element in root.iter()}
        self.unused = {words for tag, words in _UNUSED.items() if tag in elements}
        unit = elements["unit"].attrib.get("meter", "1") if "unit" in elements else "1"
        self.unit_m = float(unit)
        if not 0 < self.unit_m < np.inf:
            raise ValueError(f"its unit is {unit} m")
        axis = (elements["up_axis"].text or "").strip() if "up_axis" in elements else "Y_UP"
        self.up = _AXES.get(axis, "y")
        self._images = {
            (element.text or "").strip() for element in root.iter() if element.tag.endswith("from")
        }
        self._appearances: dict[int, Appearance] = {}
        self._kept: list[Any] = []  # Materials stay alive, so that their ids stay unique.

    def look(self, material: Any) -> Appearance:
        """Appearance of a material of the reader, which copies it for each part."""
        image = material.baseColorTexture
        key = id(material if image is None else image)
        if key not in self._appearances:
            self._kept.append(material)
            self._appearances[key] = self._read(material)
        return self._appearances[key]

    def _read(self, material: Any) -> Appearance:
        red, green, blue, opacity = (np.asarray(material.baseColorFactor) / 255).tolist()
        if opacity < 1:
            self.unused.add("transparency")
        if material.emissiveFactor is not None and np.any(material.emissiveFactor):
            self.unused.add("emission")
        image = material.baseColorTexture
        return Appearance(
            name=str(material.name or Appearance().name),
            rgb=(red, green, blue),
            image=None if image is None else picture(image),
            # The reader's roughness is the microfacet slope of the shininess.
            alpha=float(material.roughnessFactor),
        )

    def missing_files(self, path: Path) -> list[str]:
        """Images that the file names, and which do not exist."""
        names = [name.removeprefix("file://") for name in sorted(self._images)]
        return [name for name in names if "." in name and not (path.parent / name).is_file()]
