"""By how much levels of an image change, each by its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating]

_ENDS = (0.001, 0.004, 0.015)
# Of the pixels, up to which a curve's bins reach.
_SHARES = np.sort([*np.linspace(0, 1, 25), *_ENDS, *(1 - np.array(_ENDS))])
_STEPS = 64  # Of levels in a code, that a curve is looked up by.


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Mean change by level."""

    levels: Image  # Rising.
    change: Image

    def step(self, image: Image) -> Image:
        """Change of each pixel; beyond the levels that of the last."""
        first, last = self.levels[0], self.levels[-1]
        table = np.arange(int((last - first) * _STEPS) + 2) / _STEPS + first
        change = np.interp(table, self.levels, self.change).astype(np.float32)
        return change[_steps(np.clip(image, first, last), first)]

    def of(self, image: Image) -> Image:
        """The image changed; beyond the levels the curve goes on as it ends."""
        if len(self.levels) == 1:
            return image + self.step(image)
        inside = np.clip(image, self.levels[0], self.levels[-1])
        rise = np.diff(self.change) / np.diff(self.levels)
        beyond = np.where(image < inside, 1 + rise[0], 1 + rise[-1]) * (image - inside)
        return (inside + self.step(inside) + beyond).astype(np.float32)


def told(levels: Image, change: Image) -> Curve:
    """Tell a curve by bins of equal shares of the pixels, and a few of the darkest and brightest.

    Args:
        levels: (h, w) [DN].
        change: (h, w) [DN] of each pixel.
    """
    steps = _steps(levels, levels.min()).ravel()
    have = np.bincount(steps)
    middle = (np.cumsum(have) - 0.5 * have) / steps.size
    which = np.searchsorted(_SHARES[1:-1], middle)[steps]
    count = np.bincount(which)
    known = count > 0
    at, mean = (np.bincount(which, one.ravel())[known] / count[known] for one in (levels, change))
    return Curve(at, mean)


def _steps(levels: Image, first: float) -> NDArray[np.intp]:
    """How many steps each level is above the first."""
    return ((levels - np.float32(first)) * _STEPS + 0.5).astype(np.intp)
