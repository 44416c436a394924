"""Pixels drawn from scenes for training, weighted so that probabilities are unbiased."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Mask


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPixels:
    """Pixels of one or more scenes."""

    values: NDArray[np.float32]  # (n, k) features.
    ndp: NDArray[np.bool_]  # (n,)
    weight: NDArray[np.float64]  # (n,) above 0; the sum is the same for each scene.
    room: NDArray[np.str_]  # (n,)

    def where(self, chosen: NDArray[np.bool_]) -> DrawnPixels:
        """Select pixels; weights do not change."""
        return DrawnPixels(
            self.values[chosen], self.ndp[chosen], self.weight[chosen], self.room[chosen]
        )


def draw_pixels(
    values: NDArray[np.float32],
    ndp: Mask,
    counted: Mask,
    *,
    room: str,
    most: int,
    rng: np.random.Generator,
) -> DrawnPixels:
    """Draw pixels of one scene, equally many with and without depth where possible.

    Holes are a few percent of a scene, so that uniform draws would mostly be uninformative. Each
    kind is weighted back to its share, so that trained probabilities are unbiased.

    Args:
        values: (h, w, k) features.
        ndp: (h, w) no-depth pixels.
        counted: (h, w), at least one True.
        room: room of the scene.
        most: greatest number of pixels, > 1.
        rng: random generator; draws are without replacement.

    Returns:
        The pixels; their weights sum to their number.
    """
    kinds = [np.flatnonzero(counted & ndp), np.flatnonzero(counted & ~ndp)]
    rarer = min(len(kinds[0]), len(kinds[1]), most // 2)
    numbers = [min(len(kind), most - rarer) for kind in kinds]
    drawn = [
        rng.choice(kind, number, replace=False) for kind, number in zip(kinds, numbers, strict=True)
    ]
    each = [len(kind) / max(number, 1) for kind, number in zip(kinds, numbers, strict=True)]
    pixels, weight = np.concatenate(drawn), np.repeat(each, numbers)
    return DrawnPixels(
        values=values.reshape(-1, values.shape[-1])[pixels],
        ndp=ndp.reshape(-1)[pixels],
        weight=weight * (len(weight) / weight.sum()),
        room=np.full(len(pixels), room),
    )


def join(scenes: Sequence[DrawnPixels]) -> DrawnPixels:
    """Concatenate scenes, each with the same sum of weights."""
    pixels = sum(len(scene.ndp) for scene in scenes)
    return DrawnPixels(
        values=np.concatenate([scene.values for scene in scenes]),
        ndp=np.concatenate([scene.ndp for scene in scenes]),
        weight=np.concatenate(
            [scene.weight * (pixels / len(scenes) / scene.weight.sum()) for scene in scenes]
        ),
        room=np.concatenate([scene.room for scene in scenes]),
    )
