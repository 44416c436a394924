"""Capture sets of the virtual camera: what it sees, beside what its users believe is there."""

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
        track: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: as `starling.learning.data.simulated_captures.write`.
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
