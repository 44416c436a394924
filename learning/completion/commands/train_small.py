"""Trains the compact network on frames that are kept in memory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion.data.layouts import ListedFrame, read_frames
from starling.learning.completion.data.training_frame import Holes, none_has_depth, training_frame
from starling.learning.completion.small import method
from starling.learning.completion.small.crops import FrameSample
from starling.learning.completion.small.settings import SmallSettings
from starling.sim.console import progress


def train_small(
    frames: Sequence[ListedFrame],
    holes: Holes,
    *,
    steps: int | None,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Read all frames, then train, or continue from the folder's checkpoint.

    Args:
        frames: frames with ground truth.
        holes: see `training_frame`.
        steps: number of steps; None uses the default.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of initial weights, crops and random holes.
        track: wraps long loops.

    Returns:
        `{"frames", "left_out", "hole_share"}`: number of frames trained on; number of frames
        without depth; mean share of pixels without depth.

    Raises:
        InputError: if a frame is invalid, or none has depth; see also `method.fit`.
    """
    samples = []
    for number, pair in enumerate(read_frames(frames, track, "read")):
        prepared = training_frame(pair, holes, seed=seed, number=number)
        if prepared is not None:
            samples.append(
                FrameSample(
                    image=prepared.image, depth_m=prepared.depth_m, truth_m=prepared.truth()
                )
            )
    if not samples:
        raise none_has_depth(len(frames))
    settings = SmallSettings() if steps is None else SmallSettings(steps=steps)
    method.fit(samples, settings, folder=folder, seed=seed, track=track)
    return {
        "frames": len(samples),
        "left_out": len(frames) - len(samples),
        "hole_share": float(np.mean([np.isnan(sample.depth_m).mean() for sample in samples])),
    }
