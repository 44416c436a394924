"""Scenes by word: a builtin name, a mesh, a Mitsuba XML or a real capture."""

from __future__ import annotations

from pathlib import Path

from starling.patterns import errors
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


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
    from starling.sim.scene import mesh, mitsuba_xml
    from starling.sim.scene.builtin import scenes
    from starling.sim.scene.captured import captured_scene

    name, _, number = word.partition(":")
    if name in scenes.BUILTIN:
        return scenes.named(name, number)
    path = Path(word)
    if path.suffix.lower() in mesh.SUFFIXES:
        return mesh.load(path, sensor)
    if path.suffix.lower() == ".xml":
        return mitsuba_xml.load(path)
    if path.is_dir():
        return captured_scene.load(path, sensor)
    known = f"Builtin: {', '.join(scenes.BUILTIN)}; meshes: {', '.join(mesh.SUFFIXES)}."
    if not path.exists() and "/" not in word:
        errors.one_of("scene", name, scenes.BUILTIN)
    raise errors.refuse(
        "scene", "must be a builtin name, a mesh, a Mitsuba XML or a capture", repr(word), known
    )
