"""Capture sets of simulated cameras: what they see, beside what their users believe is there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from patterns import errors
from sim import backend, capture_writer, progress, scenes
from sim.output import OutputFolder
from sim.scene import Scene
from sim.scenes import known
from sim.sensor import Sensor
from sim.simulate import Shot
from sim.simulate_captures import scene_seed

Shoot = Callable[[Scene, int], Shot]  # A scene as it is believed to be, and a seed.


def write(
    out: Path,
    names: Sequence[str],
    camera: Sensor,
    shoot: Shoot,
    *,
    verb: str,
    seed: int,
    arguments: Mapping[str, Any],
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Let a camera look at builtin scenes, each a room of its own, and write a capture set.

    Args:
        out: folder to make.
        names: builtin scenes, each once.
        camera: whose geometry the captures have.
        shoot: takes a capture.
        verb: what made the set, for its record.
        seed: of the set; each capture's follows from it and the scene's name.
        arguments: for the record.
        force: replace a set made before.
        tell: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: if a scene is unknown or named twice, or the folder cannot be written.
    """
    if len(set(names)) < len(names) or not names:
        found = f"{len(names)}, {len(set(names))} of them different"
        raise errors.refuse("scenes", "must be at least one, each once", found, "Correct the list.")
    info = capture_writer.info_of(
        camera, source=f"{verb} camera", licence="Apache-2.0", notes="simulated"
    )
    rates = {}
    with OutputFolder(out, force=force) as folder:
        for name in tell(names, f"{verb} captures"):
            believed = scenes.load(name, camera)
            shot = shoot(believed, scene_seed(seed, name))
            place, step_m = name.replace(":", "-"), camera.post.depth_unit_m
            capture_writer.write_scene(
                folder,
                place,
                room=place,
                truth_m=shot.layers.truth.depth_m,
                depth_unit_m=step_m,
                known=known.describe(name, believed.world_from_left, folder.path / place),
            )
            capture_writer.write_frame(
                folder,
                place,
                0,
                depth=shot.depth,
                depth_unit_m=step_m,
                infrared=(shot.ir_left, shot.ir_right),
            )
            rates[place] = float(1 - shot.depth.valid.mean())
        capture_writer.write_set(
            folder,
            info,
            camera,
            verb=verb,
            arguments={"scenes": list(names), "seed": seed, **arguments},
            figures=rates,
            renderer=backend.renderer(),
        )
    return rates
