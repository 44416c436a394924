"""Check that examples can be learnt from, and their counted pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.learning.data.example import Example, Mask
from starling.patterns.errors import refuse


def known_holes(example: Example) -> tuple[Mask, Mask]:
    """Return where the device has no depth, and which pixels count, both (h, w).

    Raises:
        InputError: if the example lacks one of them, or no pixel counts.
    """
    if example.ndp is None or example.counted is None:
        raise refuse(
            "example",
            "must have the device's holes for training and evaluation",
            f"scene {example.scene} without",
            "Give captures with depth.png and truth.png.",
        )
    if not example.ndp.shape == example.counted.shape == example.depth_m.shape:
        raise refuse(
            "ndp, counted and depth_m",
            "must share one shape",
            f"{example.ndp.shape}, {example.counted.shape} and {example.depth_m.shape}",
            f"Check scene {example.scene}.",
        )
    if not example.counted.any():
        raise refuse(
            "counted",
            "must hold a pixel",
            f"none in scene {example.scene}",
            "Use scenes with known reference depth.",
        )
    return example.ndp, example.counted


def check_learnable(examples: Sequence[Example]) -> None:
    """Refuse examples that cannot be learnt from.

    Raises:
        InputError: if there is no example, an example has no known holes or no counted pixel;
            depth is known at all counted pixels or nowhere.
    """
    if not examples:
        raise refuse("examples", "must be at least one", 0, "Give captures for training.")
    holes = pixels = 0
    for example in examples:
        ndp, counted = known_holes(example)
        holes += np.count_nonzero(ndp & counted)
        pixels += np.count_nonzero(counted)
    if not 0 < holes < pixels:
        raise refuse(
            "no-depth pixels",
            "must be some and not all of the counted ones",
            f"{holes} of {pixels}",
            "Use scenes with both; a constant cannot be learnt.",
        )
