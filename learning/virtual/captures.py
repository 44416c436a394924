"""Capture sets of the virtual camera: what it sees, beside what its users believe is there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from learning.virtual import unit
from patterns import errors
from sim import backend, capture_writer, progress, scenes
from sim.output import OutputFolder
from sim.scenes import known
from sim.simulate_captures import scene_seed


def write(
    out: Path,
    names: Sequence[str],
    *,
    seed: int = 0,
    samples: int = 16,
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Let the camera look at builtin scenes, each a room of its own, and write a capture set.

    `capture.toml` holds the data sheet's geometry, `scene.toml` the scenes as they are believed to
    be: the unit's own geometry, the true reflectances and the light stay untold. Reference depth is
    the true one in the true camera's view.

    Args:
        out: folder to make.
        names: builtin scenes, each once.
        seed: of the set; each capture's conditions follow from it and the scene's name.
        samples: paths a coarse pixel of indirect light.
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
    camera = unit.camera()
    info = capture_writer.info_of(
        camera, source="virtual camera", licence="Apache-2.0", notes="simulated"
    )
    rates = {}
    with OutputFolder(out, force=force) as folder:
        for name in tell(names, "virtual captures"):
            believed = scenes.load(name, camera)
            shot = unit.capture(believed, scene_seed(seed, name), samples=samples)
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
            verb="virtual",
            arguments={"scenes": list(names), "seed": seed, "samples": samples},
            figures=rates,
            renderer=backend.renderer(),
        )
    return rates
