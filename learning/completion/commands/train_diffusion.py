"""An image generator learns to complete depth from listed frames, read when they are drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion.data.layouts import Listed
from starling.learning.completion.data.training_frame import Holes
from starling.learning.completion.diffusion import training, weights
from starling.learning.completion.diffusion.unread import Unread
from starling.learning.completion.diffusion.variants import Variant
from starling.sim.console import progress


def train_diffusion(
    frames: Sequence[Listed],
    holes: Holes,
    *,
    start: str,
    variant: Variant,
    steps: int | None,
    at_once: int | None,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Learn, or go on with what lies in the folder; weights are left in `folder/weights`.

    Args:
        frames: with truth.
        holes: as `training_frame` takes them.
        start: weights of an image generator, a folder or the id on a hub.
        variant: how it is told what is seen.
        steps: None leaves the settings' number, and
        at_once: so does it here: frames that the device holds at a time.
        folder: gets checkpoint, loss curve and weights.
        seed: fixes what is drawn, random holes too.
        track: wraps the loop over steps.

    Returns:
        `{"frames", "left_out", "hole_share"}`: those there are; of the ones that were drawn since
        this call, those without any depth, and the others' mean share of pixels without.

    Raises:
        InputError: whatever is wrong with a frame; as `weights.load` and `training.train`.
    """
    asked = {"steps": steps, "at_once": at_once}
    given = {name: value for name, value in asked.items() if value is not None}
    settings = dataclasses.replace(training.Settings(), **given)
    drawn = Unread(frames=frames, holes=holes, seed=seed)
    training.train(
        weights.load(start), variant, drawn, settings, folder=folder, seed=seed, track=track
    )
    shares = [share for share in drawn.shares.values() if share < 1]
    return {
        "frames": len(frames),
        "left_out": len(drawn.shares) - len(shares),
        "hole_share": float(np.mean(shares)) if shares else None,
    }
