"""Capture sets of the virtual camera, with the assumed scenes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from starling.learning.data import simulated_captures
from starling.learning.data.virtual import unit
from starling.sim.console import progress


def write(
    out: Path,
    names: Sequence[str],
    *,
    seed: int = 0,
    samples: int = 16,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate builtin scenes with the virtual camera, each a room, and write a capture set.

    `capture.toml` holds the geometry of the data sheet and `scene.toml` the assumed scenes. The
    unit's true geometry, reflectances and light are not written. Reference depth is the true one in
    the true camera's view.

    Args:
        out: output folder.
        names: builtin scenes, each once.
        seed: seed of the set; each capture's conditions follow from it and the scene's name.
        samples: paths per coarse pixel of indirect light.
        force: replace an earlier set.
        track: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: see `starling.learning.data.simulated_captures.write`.
    """
    return simulated_captures.write(
        out,
        names,
        unit.camera(),
        partial(unit.capture, samples=samples),
        verb="virtual",
        seed=seed,
        arguments={"samples": samples},
        force=force,
        track=track,
    )
