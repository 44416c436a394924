"""A frame as a network learns from it: with its camera's holes, or random ones in their stead."""

from __future__ import annotations

import dataclasses
from typing import Literal

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.small.crops import Sample
from starling.learning.completion.small.random_holes import with_random_holes
from starling.patterns.errors import InputError, refuse

Holes = Literal["camera", "random"]


def none_has_depth(count: int) -> InputError:
    """Build (not raise) the refusal of frames of which none has depth."""
    advice = "Give others: of these nothing can be learnt."
    return refuse("frames", "must have depth", f"none in all {count}", advice)


def training_frame(one: Pair, holes: Holes, *, seed: int, number: int) -> Pair | None:
    """Make a frame ready, or None if it has no depth, of which nothing is learnt.

    Args:
        one: the frame.
        holes: the camera's own, or random ones, as a control.
        seed: of random holes.
        number: the frame's, so that no two have the same.

    Raises:
        InputError: if its truth is not known, where random holes are asked for.
    """
    if holes == "random":
        own = Sample(image=one.image, depth_m=one.depth_m, truth_m=one.truth())
        one = dataclasses.replace(one, depth_m=with_random_holes(own, seed, number).depth_m)
    return one if one.valid.any() else None
