"""Loading of scenes by specifier: builtin name, mesh, Mitsuba XML or real capture."""

from __future__ import annotations

from pathlib import Path

from starling.patterns import errors
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


def load(specifier: str, sensor: Sensor) -> Scene:
    """Load the scene of a specifier.

    Args:
        specifier: One of the following. A builtin name: `wall`, `staircase`, `tabletop`, `clutter`
            or `room`, also as NAME:NUMBER with a distance in metres or a seed. A mesh file: `.ply`,
            `.obj` or `.glb`. A Mitsuba `.xml`. The folder of a scene in a capture set.
        sensor: Sensor whose field of view a mesh's default pose fits.

    Raises:
        InputError: if the specifier is unknown, or the scene is refused.
    """
    from starling.sim.scene import mesh, mitsuba_xml
    from starling.sim.scene.builtin import scenes
    from starling.sim.scene.captured import captured_scene

    name, _, number = specifier.partition(":")
    if name in scenes.BUILTIN:
        return scenes.named(name, number)
    path = Path(specifier)
    if path.suffix.lower() in mesh.SUFFIXES:
        return mesh.load(path, sensor)
    if path.suffix.lower() == ".xml":
        return mitsuba_xml.load(path)
    if path.is_dir():
        return captured_scene.load(path, sensor)
    known = f"Builtin: {', '.join(scenes.BUILTIN)}; meshes: {', '.join(mesh.SUFFIXES)}."
    if not path.exists() and "/" not in specifier:
        errors.one_of("scene", name, scenes.BUILTIN)
    raise errors.refuse(
        "scene",
        "must be a builtin name, a mesh, a Mitsuba XML or a capture",
        repr(specifier),
        known,
    )
