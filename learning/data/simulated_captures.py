"""Capture sets of simulated cameras, with the scenes and cameras that users assume."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.captures import writer
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import progress
from starling.sim.console.output import OutputFolder
from starling.sim.render import backend
from starling.sim.scene import sources
from starling.sim.scene.captured import known_geometry
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

Shoot = Callable[[Scene, int], Shot]  # Maps the assumed scene and a seed to a shot.


def write(
    out: Path,
    names: Sequence[str],
    camera: Sensor,
    shoot: Shoot,
    *,
    verb: str,
    seed: int,
    arguments: Mapping[str, Any],
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate builtin scenes, each a room, and write a capture set.

    Args:
        out: output folder.
        names: builtin scenes, each once.
        camera: assumed camera, whose geometry the captures have.
        shoot: simulates a shot.
        verb: name of the program, for the record.
        seed: seed of the set; that of each capture follows from it and the scene's name.
        arguments: for the record.
        track: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: if a scene is unknown or named twice, or the folder cannot be written.
    """
    if len(set(names)) < len(names) or not names:
        got = f"{len(names)}, {len(set(names))} of them different"
        raise errors.refuse("scenes", "must be at least one, each once", got, "Correct the list.")
    info = writer.info_of(camera, source=f"{verb} camera", licence="Apache-2.0", notes="simulated")
    rates = {}
    with OutputFolder(out) as folder:
        for name in track(names, f"{verb} captures"):
            assumed = sources.load(name, camera)
            shot = shoot(assumed, scene_seed(seed, name))
            place, step_m = name.replace(":", "-"), camera.post.depth_unit_m
            writer.write_scene(
                folder,
                place,
                room=place,
                truth_m=shot.layers.truth.depth_m,
                depth_unit_m=step_m,
                known=known_geometry.describe(name, assumed.file_from_left, folder.path / place),
            )
            writer.write_frame(
                folder,
                place,
                0,
                depth=shot.depth,
                depth_unit_m=step_m,
                infrared=(shot.ir_left, shot.ir_right),
            )
            rates[place] = float(1 - shot.depth.valid.mean())
        writer.write_set(
            folder,
            info,
            camera,
            verb=verb,
            arguments={"scenes": list(names), "seed": seed, **arguments},
            figures=rates,
            renderer=backend.renderer(),
        )
    return rates
