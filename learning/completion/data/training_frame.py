"""A training frame: with the camera's holes, or with random ones."""

from __future__ import annotations

import dataclasses
from typing import Literal

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.small.crops import FrameSample
from starling.learning.completion.small.random_holes import with_random_holes
from starling.patterns.errors import InputError, refuse

Holes = Literal["camera", "random"]


def none_has_depth(count: int) -> InputError:
    """Build the error of frames that all have no depth."""
    advice = "Give other frames."
    return refuse("frames", "must have depth", f"none in all {count}", advice)


def training_frame(pair: Pair, holes: Holes, *, seed: int, number: int) -> Pair | None:
    """Prepare a frame for training; None if it has no depth.

    Args:
        pair: the frame.
        holes: the camera's own, or random ones as a control.
        seed: seed of random holes.
        number: number of the frame, so that frames differ.

    Raises:
        InputError: if random holes are requested and the truth is unknown.
    """
    if holes == "random":
        sample = FrameSample(image=pair.image, depth_m=pair.depth_m, truth_m=pair.truth())
        pair = dataclasses.replace(pair, depth_m=with_random_holes(sample, seed, number).depth_m)
    return pair if pair.valid.any() else None
