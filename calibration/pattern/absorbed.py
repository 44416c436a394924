"""Motion of an emitter that a re-solved pattern image absorbs.

When an emitter moves, dots shift in each view. A re-solved image follows the mean shift over the
views in each direction. Only the difference between views at different distances determines the
emitter's position. A step without this correction would move the image instead of the emitter.

Source: the projector of variable projection (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973),
for an image with many pixels in each direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from starling.calibration.pattern import cosine_image
from starling.calibration.pattern.cosine_image import Array, Grid

_CELL = 8  # Cell size in pixels of the pattern image; shifts vary slowly with direction.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AbsorbedMotion:
    """Mean derivative of the cosines over all views, by direction."""

    grid: Grid
    partials: Mapping[str, tuple[Array, Array]]  # By parameter: derivatives of a and b, (h, w).

    def interpolate(self, name: str, cosines: Array) -> Array:
        """Return the mean derivative (n, 2) in the directions `cosines` (n, 2)."""
        place, values = self.grid.place(cosines), np.zeros((2, len(cosines)), np.float32)
        for image, row in zip(self.partials[name], values, strict=True):
            cosine_image.read(image, place, row)
        return values.T


def average(
    views: Iterable[tuple[Array, Array, Mapping[str, Array]]], grid: Grid
) -> AbsorbedMotion:
    """Average derivatives over views.

    Args:
        views: for each view, cosines (n, 2), weights (n,), and derivatives (n, 2) of the cosines
            by parameter. Missing derivatives count as 0.
        grid: grid of the pattern image.
    """
    coarse = Grid(half_a=grid.half_a, half_b=grid.half_b, step=_CELL * grid.step)
    total = np.zeros(coarse.shape, np.float32)
    sums: dict[str, tuple[Array, Array]] = {}
    for cosines, weight, partials in views:
        place = coarse.place(cosines)
        cosine_image.add(total, place, weight)
        for name, partial in partials.items():
            zeros = np.zeros_like(total), np.zeros_like(total)
            for axis, image in enumerate(sums.setdefault(name, zeros)):
                cosine_image.add(image, place, weight * np.nan_to_num(partial[:, axis]))
    share = 1 / np.maximum(total, np.float32(1e-6))
    return AbsorbedMotion(
        grid=coarse, partials={name: (a * share, b * share) for name, (a, b) in sums.items()}
    )
