"""Tone curve between two images: mean change as a function of the level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating]

_ENDS = (0.001, 0.004, 0.015)  # Quantiles of narrow bins at the dark and bright end.
_QUANTILES = np.sort([*np.linspace(0, 1, 25), *_ENDS, *(1 - np.array(_ENDS))])  # Limits of bins.
_STEPS = 64  # Entries per DN of the lookup table.


@dataclass(frozen=True, slots=True, eq=False)
class ToneCurve:
    """Mean change by level."""

    levels: Image  # Ascending [DN].
    change: Image  # [DN].

    def change_at(self, image: Image) -> Image:
        """Look up the change of each pixel; constant outside the curve's range."""
        first, last = self.levels[0], self.levels[-1]
        table = np.arange(int((last - first) * _STEPS) + 2) / _STEPS + first
        change = np.interp(table, self.levels, self.change).astype(np.float32)
        return change[_table_index(np.clip(image, first, last), first)]

    def apply(self, image: Image) -> Image:
        """Apply the curve to an image; it is extrapolated linearly outside its range."""
        if len(self.levels) == 1:
            return image + self.change_at(image)
        inside = np.clip(image, self.levels[0], self.levels[-1])
        slope = np.diff(self.change) / np.diff(self.levels)
        outside = np.where(image < inside, 1 + slope[0], 1 + slope[-1]) * (image - inside)
        return (inside + self.change_at(inside) + outside).astype(np.float32)


def fit_tone_curve(levels: Image, change: Image) -> ToneCurve:
    """Average the change in bins of equal numbers of pixels, with narrow bins at both ends.

    Args:
        levels: (h, w) [DN].
        change: (h, w) [DN] change of each pixel.
    """
    index = _table_index(levels, levels.min()).ravel()
    pixels = np.bincount(index)
    quantile = (np.cumsum(pixels) - 0.5 * pixels) / index.size
    bins = np.searchsorted(_QUANTILES[1:-1], quantile)[index]
    count = np.bincount(bins)
    known = count > 0
    level, mean = (
        np.bincount(bins, values.ravel())[known] / count[known] for values in (levels, change)
    )
    return ToneCurve(level, mean)


def _table_index(levels: Image, first: float) -> NDArray[np.intp]:
    """Index of each level in a lookup table that starts at `first`."""
    return ((levels - np.float32(first)) * _STEPS + 0.5).astype(np.intp)
