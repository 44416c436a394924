"""Trains an image generator to complete depth from frames that are read when they are drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion.data.layouts import ListedFrame
from starling.learning.completion.data.training_frame import Holes
from starling.learning.completion.diffusion import Variant, training, weights
from starling.learning.completion.diffusion.data import ListedSamples
from starling.sim.console import progress


def train_diffusion(
    frames: Sequence[ListedFrame],
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
    """Train, or continue from the folder's checkpoint, and write the weights to `folder/weights`.

    Args:
        frames: frames with ground truth.
        holes: see `training_frame`.
        start: weights of an image generator, a folder or an id on the Hugging Face hub.
        variant: conditioning of the generator.
        steps: number of steps; None uses the default.
        at_once: frames on the device at a time; None uses the default.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of all random draws, including random holes.
        track: wraps the loop over steps.

    Returns:
        `{"frames", "left_out", "hole_share"}`: number of frames; number of frames without depth
        among those drawn by this call; mean share of holes of the others.

    Raises:
        InputError: if a frame is invalid; see also `weights.load` and `training.train`.
    """
    options = {"steps": steps, "at_once": at_once}
    changes = {name: value for name, value in options.items() if value is not None}
    settings = dataclasses.replace(training.DiffusionSettings(), **changes)
    samples = ListedSamples(frames=frames, holes=holes, seed=seed)
    training.train(
        weights.load(start), variant, samples, settings, folder=folder, seed=seed, track=track
    )
    shares = [share for share in samples.shares.values() if share < 1]
    return {
        "frames": len(frames),
        "left_out": len(samples.shares) - len(shares),
        "hole_share": float(np.mean(shares)) if shares else None,
    }
