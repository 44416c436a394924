"""The work of `starling train completion`: captures with truth in, weights out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from learning import captured, work_folder
from learning.completion.diffusion.variants import Variant
from learning.completion.frame import checked
from learning.completion.pairs import Picture, pairs
from learning.completion.small import small
from learning.completion.small.crops import Sample
from learning.completion.small.random_holes import with_random_holes
from learning.completion.small.settings import Settings
from patterns.errors import needs
from sim import capture, progress
from sim.capture import CaptureSet
from sim.output import refuse_own_input

Holes = Literal["camera", "random"]


def train_captures(
    captures: str,
    out: Path,
    *,
    start: str = "",
    variant: Variant = "rgbd",
    picture: Picture = "ir_left",
    holes: Holes = "camera",
    rooms: Sequence[str] | None = None,
    steps: int | None = None,
    seed: int = 0,
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Train a network; what was cut short is gone on with when asked for again.

    Args:
        captures: capture set with reference depth and the camera's own.
        out: folder for weights, checkpoint and loss curve.
        start: weights of an image generator, a folder or the id on a hub, that learns to complete
            depth; empty trains the compact network from nothing.
        variant: how the generator is told what is seen; see `diffusion.variants`.
        picture: the image that goes with the depth.
        holes: the camera's own, or random ones in their stead, as a control.
        rooms: to learn from; None takes all.
        steps: None leaves the settings' number.
        seed: of first weights, crops, and random holes.
        force: drop what starling left in the folder.
        tell: wraps loops that take long.

    Returns:
        `{"method", "frames", "hole_share", "out", "seconds"}`.

    Raises:
        InputError: whatever is wrong with the captures or the folder.
    """
    begun = time.perf_counter()
    opened = capture.open_set(captures)
    refuse_own_input(out, opened.path)
    captured.check_rooms(opened, rooms or ())
    settings = Settings() if steps is None else Settings(steps=steps)
    asked = {"captures": captures, "picture": picture, "holes": holes, "rooms": rooms}
    kind = {"method": "diffusion", "start": start, "variant": variant} if start else {}
    arguments = {"method": "small", **kind, **asked, "steps": steps, "seed": seed}
    work_folder.begin(out, arguments, force=force)
    samples = _samples(opened, picture, holes, rooms, seed, tell)
    if start:
        _fit_diffusion(samples, start, variant, steps, folder=out, seed=seed, tell=tell)
    else:
        small.fit(samples, settings, folder=out, seed=seed, tell=tell)
    figures = {
        "method": arguments["method"],
        "frames": len(samples),
        "hole_share": float(np.mean([np.isnan(sample.depth_m).mean() for sample in samples])),
    }
    work_folder.end(out, "train completion", arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - begun, 3)}


def _samples(
    opened: CaptureSet,
    picture: Picture,
    holes: Holes,
    rooms: Sequence[str] | None,
    seed: int,
    tell: progress.Progress,
) -> list[Sample]:
    found: list[Sample] = []
    for one in pairs(opened, picture, rooms=rooms, tell=tell, label="read"):
        sample = Sample(image=one.image, depth_m=one.depth_m, truth_m=one.truth())
        if holes == "random":
            sample = with_random_holes(sample, seed, len(found))
        found.append(sample)
    return found


def _fit_diffusion(
    samples: Sequence[Sample],
    start: str,
    variant: Variant,
    steps: int | None,
    *,
    folder: Path,
    seed: int,
    tell: progress.Progress,
) -> None:
    """Let an image generator learn to complete depth; its weights are left in `folder/weights`."""
    try:
        from learning.completion.diffusion import training, weights
        from learning.completion.diffusion.samples import Sample as Told
    except ModuleNotFoundError as error:
        raise needs("diffusion", str(error.name), "completion") from error
    settings = training.Settings() if steps is None else training.Settings(steps=steps)
    told = [
        Told(checked(one.image, one.depth_m, np.isfinite(one.depth_m)), one.truth_m)
        for one in samples
    ]
    parts = weights.load(start)
    training.train(parts, variant, told, settings, folder=folder, seed=seed, tell=tell)
