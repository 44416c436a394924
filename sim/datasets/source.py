"""Sources of a plan's scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.console.names import distinct_names
from starling.sim.datasets import draw
from starling.sim.datasets.draw import Draw, Fixed, Range, refuse_unknown, text, weight

_USD = (".usd", ".usda", ".usdc", ".usdz")
_FILES = (".ply", ".obj", ".glb", ".stl", ".dae", *_USD, ".xml")
_MESHES = (".ply", ".obj", ".glb")  # Of folders, where others are often collision meshes.


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneSpecifier:
    """A scene specifier for `starling.sim.scene.sources.load`."""

    text: str
    room: str  # Scenes of one room are not independent samples.
    known: bool = True  # Whether the geometry is known without captures.


@dataclass(frozen=True, kw_only=True, slots=True)
class Pile:
    """Meshes to drop onto a table."""

    folder: Path  # Meshes are identified by their path inside it.
    paths: tuple[Path, ...]
    reflectances: tuple[float, ...]
    seed: int
    room: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Builtin:
    """Builtin scenes of one family, NAME:NUMBER."""

    weight: float
    scene: str
    number: Draw

    def chosen(self, rng: np.random.Generator) -> SceneSpecifier:
        """Draw a scene."""
        word = f"{self.scene}:{self.number.drawn(rng)}"
        return SceneSpecifier(text=word, room=word.replace(":", "-"))


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneFiles:
    """Meshes and Mitsuba XMLs; each file is a scene."""

    weight: float
    paths: tuple[Path, ...]
    rooms: Mapping[Path, str]  # Distinct names of the files.

    def chosen(self, rng: np.random.Generator) -> SceneSpecifier:
        """Draw a scene."""
        path = self.paths[int(rng.integers(len(self.paths)))]
        return SceneSpecifier(text=str(path), room=self.rooms[path])


@dataclass(frozen=True, kw_only=True, slots=True)
class Captured:
    """Scenes of a capture set, with the geometry of their reference depth."""

    weight: float
    paths: tuple[Path, ...]
    rooms: tuple[str, ...]

    def chosen(self, rng: np.random.Generator) -> SceneSpecifier:
        """Draw a scene."""
        number = int(rng.integers(len(self.paths)))
        return SceneSpecifier(text=str(self.paths[number]), room=self.rooms[number], known=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Dropped:
    """Tables with meshes of a folder on them; a mesh can occur more than once."""

    weight: float
    folder: Path
    paths: tuple[Path, ...]
    count: Draw
    reflectance: Draw

    def chosen(self, rng: np.random.Generator) -> Pile:
        """Draw meshes, their reflectances, and a seed for their poses."""
        count = int(self.count.drawn(rng))
        numbers = rng.integers(len(self.paths), size=count)
        seed = int(rng.integers(2**31))
        return Pile(
            folder=self.folder,
            paths=tuple(self.paths[number] for number in numbers),
            reflectances=tuple(float(self.reflectance.drawn(rng)) for _ in numbers),
            seed=seed,
            room=f"table-{seed}",
        )


Setting = SceneSpecifier | Pile
Source = Builtin | SceneFiles | Captured | Dropped


def read_source(table: Mapping[str, Any], folder: Path, name: str) -> Source:
    """Parse one source.

    Args:
        table: the source's table in the plan.
        folder: folder at which relative paths start.
        name: name of the source in error messages.

    Raises:
        InputError: if the kind or a key is unknown, or a file is missing.
    """
    kind = text(table, "kind", name, "builtin")
    errors.one_of(f"{name}.kind", kind, _KINDS)
    keys, build = _KINDS[kind]
    refuse_unknown(table, ("kind", "weight", *keys), name)
    return build(table, folder, name)


def _builtin(table: Mapping[str, Any], folder: Path, name: str) -> Builtin:
    from starling.sim.scene.builtin import scenes

    family = text(table, "scene", name, "clutter")
    number = draw.read(table.get("number", 0), f"{name}.number")
    for end in number.ends:
        scenes.refuse_number(family, end)
    whole = scenes.BUILTIN[family][2] == 0
    if whole and isinstance(number, Range) and not number.whole:
        rule = "must be whole, as it is a seed"
        raise errors.refuse(f"{name}.number", rule, "a range", "Add whole = true.")
    return Builtin(weight=weight(table, name), scene=family, number=number)


def _files(table: Mapping[str, Any], folder: Path, name: str) -> SceneFiles:
    words = table.get("paths")
    if not isinstance(words, list) or not words or not all(isinstance(word, str) for word in words):
        raise errors.refuse(f"{name}.paths", "must list files", repr(words), "As ['a.glb'].")
    paths = tuple(folder / word for word in words)
    for path in paths:
        _refuse_other(path, _FILES, f"{name}.paths")
    return SceneFiles(weight=weight(table, name), paths=paths, rooms=distinct_names(paths))


def _captured(table: Mapping[str, Any], folder: Path, name: str) -> Captured:
    from starling.sim.captures import capture

    scenes = capture.open_set(folder / text(table, "folder", name, "captures")).scenes
    return Captured(
        weight=weight(table, name),
        paths=tuple(scene.path for scene in scenes),
        rooms=tuple(scene.room for scene in scenes),
    )


def _dropped(table: Mapping[str, Any], folder: Path, name: str) -> Dropped:
    where = folder / text(table, "folder", name, "meshes")
    paths = tuple(sorted(path for path in where.rglob("*") if path.suffix.lower() in _MESHES))
    if not paths:
        rule = f"must hold meshes ({', '.join(_MESHES)})"
        raise errors.refuse(f"{name}.folder", rule, where, "Check the path.")
    count = draw.read(table.get("count", 5), f"{name}.count")
    reflectance = draw.read(table.get("reflectance", 0.5), f"{name}.reflectance")
    for end in count.ends:
        errors.in_interval(f"{name}.count", end, 1, 200)
    for end in reflectance.ends:
        errors.in_interval(f"{name}.reflectance", end, 0.0, 1.0)
    if isinstance(count, Range) and not count.whole:
        raise errors.refuse(f"{name}.count", "must be whole", "a range", "Add whole = true.")
    if isinstance(count, Fixed) and type(count.value) is not int:
        raise errors.refuse(f"{name}.count", "must be whole", count.value, "Round it.")
    return Dropped(
        weight=weight(table, name),
        folder=where,
        paths=paths,
        count=count,
        reflectance=reflectance,
    )


def _refuse_other(path: Path, suffixes: tuple[str, ...], name: str) -> None:
    if path.suffix.lower() not in suffixes:
        raise errors.refuse(name, f"must be of {', '.join(suffixes)}", path, "Convert it.")
    if not path.is_file():
        raise errors.refuse(name, "must be files that exist", path, "Check the path.")


_Build = Callable[[Mapping[str, Any], Path, str], Source]
_KINDS: dict[str, tuple[tuple[str, ...], _Build]] = {
    "builtin": (("scene", "number"), _builtin),
    "files": (("paths",), _files),
    "captures": (("folder",), _captured),
    "dropped": (("folder", "count", "reflectance"), _dropped),
}
