"""Scenes by word: a builtin name, a mesh, a Mitsuba XML or a real capture."""

from __future__ import annotations

from pathlib import Path

from patterns import errors
from sim.scene import Scene
from sim.sensor import Sensor


def load(word: str, sensor: Sensor) -> Scene:
    """Load the scene that a word names.

    Args:
        word: `wall`, `staircase`, `tabletop`, `clutter` or `room`, each also as NAME:NUMBER (a
            distance in metres or a seed); a `.ply`, `.obj` or `.glb` file; a Mitsuba `.xml`; or one
            scene's folder of a capture set.
        sensor: whose field a mesh's default view fits.

    Raises:
        InputError: if the word names nothing of these, or what it names is refused.
    """
    from sim.scenes import builtin, captured, mesh_file, xml_file

    name, _, number = word.partition(":")
    if name in builtin.BUILTIN:
        return builtin.named(name, number)
    path = Path(word)
    if path.suffix.lower() in mesh_file.SUFFIXES:
        return mesh_file.load(path, sensor)
    if path.suffix.lower() == ".xml":
        return xml_file.load(path)
    if path.is_dir():
        return captured.load(path, sensor)
    known = f"Builtin: {', '.join(builtin.BUILTIN)}; meshes: {', '.join(mesh_file.SUFFIXES)}."
    if not path.exists() and "/" not in word:
        errors.one_of("scene", name, builtin.BUILTIN)
    raise errors.refuse(
        "scene", "must be a builtin name, a mesh, a Mitsuba XML or a capture", repr(word), known
    )
