"""Whether anything can be learnt from examples, and which of their pixels count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.learning.data.example import Example, Mask
from starling.patterns.errors import refuse


def known_holes(example: Example) -> tuple[Mask, Mask]:
    """Where the device has no depth, and where that counts, both (h, w).

    Raises:
        InputError: if the example does not know one of them, or no pixel counts.
    """
    if example.ndp is None or example.counted is None:
        raise refuse(
            "example",
            "must have the device's holes to be learnt from",
            f"scene {example.scene} without",
            "Give captures with depth.png and truth.png.",
        )
    if not example.ndp.shape == example.counted.shape == example.depth_m.shape:
        raise refuse(
            "ndp, counted and depth_m",
            "must share one shape",
            f"{example.ndp.shape}, {example.counted.shape} and {example.depth_m.shape}",
            f"Look at scene {example.scene}.",
        )
    if not example.counted.any():
        raise refuse(
            "counted",
            "must hold a pixel",
            f"none in scene {example.scene}",
            "Take scenes with known reference.",
        )
    return example.ndp, example.counted


def check_learnable(examples: Sequence[Example]) -> None:
    """Refuse examples that nothing can be learnt from.

    Raises:
        InputError: if there is none, one does not know its holes or counts no pixel, or all counted
            pixels of all examples are without depth, or none is.
    """
    if not examples:
        raise refuse("examples", "must be at least one", 0, "Give captures to learn from.")
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
            "Take scenes with both: what never varies cannot be learnt.",
        )
