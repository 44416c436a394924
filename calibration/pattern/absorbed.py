"""What an image of a pattern, solved anew, takes over of a move of its emitter.

Where an emitter is moved, dots slide in every view; what they slide by on the average over the
views that look in one direction, the image follows. Only the rest tells that the emitter moved: how
views of other distances differ. A step that leaves this out moves the image instead of the emitter.

Source: the projector of variable projection (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973),
for an image whose directions are each seen by many pixels.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from starling.calibration.pattern import cosine_image
from starling.calibration.pattern.cosine_image import Array, Grid

_CELL = 8  # Pixels of the pattern's image: slides vary slowly over directions.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Absorbed:
    """Mean derivative of the cosines over all views, by direction."""

    grid: Grid
    partials: Mapping[str, tuple[Array, Array]]  # By parameter: of a and b, each (h, w).

    def at(self, name: str, cosines: Array) -> Array:
        """Mean derivative (n, 2) in the directions `cosines` (n, 2)."""
        place, out = self.grid.place(cosines), np.zeros((2, len(cosines)), np.float32)
        for image, row in zip(self.partials[name], out, strict=True):
            cosine_image.read(image, place, row)
        return out.T


def of(parts: Iterable[tuple[Array, Array, Mapping[str, Array]]], grid: Grid) -> Absorbed:
    """Average derivatives over views.

    Args:
        parts: of each view: cosines (n, 2), weights (n,), derivatives (n, 2) of the cosines by
            parameter; what a view does not tell of is 0 there.
        grid: of the pattern's image.
    """
    coarse = Grid(half_a=grid.half_a, half_b=grid.half_b, step=_CELL * grid.step)
    total = np.zeros(coarse.shape, np.float32)
    sums: dict[str, tuple[Array, Array]] = {}
    for cosines, weight, partials in parts:
        place = coarse.place(cosines)
        cosine_image.add(total, place, weight)
        for name, partial in partials.items():
            empty = np.zeros_like(total), np.zeros_like(total)
            for axis, image in enumerate(sums.setdefault(name, empty)):
                cosine_image.add(image, place, weight * np.nan_to_num(partial[:, axis]))
    share = 1 / np.maximum(total, np.float32(1e-6))
    return Absorbed(
        grid=coarse, partials={name: (a * share, b * share) for name, (a, b) in sums.items()}
    )
