"""The compact network learns from listed frames, which it holds in memory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion.data.layouts import Listed, readings
from starling.learning.completion.data.training_frame import Holes, none_has_depth, training_frame
from starling.learning.completion.small import method
from starling.learning.completion.small.crops import Sample
from starling.learning.completion.small.settings import Settings
from starling.sim.console import progress


def train_small(
    frames: Sequence[Listed],
    holes: Holes,
    *,
    steps: int | None,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Read all frames, then learn, or go on with what lies in the folder.

    Args:
        frames: with truth.
        holes: as `training_frame` takes them.
        steps: None leaves the settings' number.
        folder: gets checkpoint, loss curve and weights.
        seed: fixes first weights, crops and random holes.
        track: wraps loops that take long.

    Returns:
        `{"frames", "left_out", "hole_share"}`: those learnt from; those without any depth; mean
        share of pixels without depth.

    Raises:
        InputError: whatever is wrong with a frame; if none has depth; as `small.fit`.
    """
    samples = []
    for number, one in enumerate(readings(frames, track, "read")):
        ready = training_frame(one, holes, seed=seed, number=number)
        if ready is not None:
            told = Sample(image=ready.image, depth_m=ready.depth_m, truth_m=ready.truth())
            samples.append(told)
    if not samples:
        raise none_has_depth(len(frames))
    settings = Settings() if steps is None else Settings(steps=steps)
    method.fit(samples, settings, folder=folder, seed=seed, track=track)
    return {
        "frames": len(samples),
        "left_out": len(frames) - len(samples),
        "hole_share": float(np.mean([np.isnan(sample.depth_m).mean() for sample in samples])),
    }
