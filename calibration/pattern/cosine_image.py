"""Bilinear reading of, and accumulation in, an image over direction cosines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, kw_only=True, slots=True)
class Grid:
    """Pixel grid over direction cosines, centred on the axis."""

    half_a: float  # Largest |a|.
    half_b: float
    step: float  # Cosine per pixel.

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (h, w)."""
        return 2 * math.ceil(self.half_b / self.step) + 1, 2 * math.ceil(
            self.half_a / self.step
        ) + 1

    def place(self, cosines: Array) -> Array:
        """Convert cosines (n, 2) to pixel coordinates x, y (n, 2)."""
        height, width = self.shape
        middle = np.array([(width - 1) / 2, (height - 1) / 2], np.float32)
        return cosines * np.float32(1 / self.step) + middle

    def cosines(self) -> tuple[Array, Array]:
        """Return the cosines a (w,) of the columns and b (h,) of the rows."""
        height, width = self.shape
        return (
            (np.arange(width) - (width - 1) / 2) * self.step,
            (np.arange(height) - (height - 1) / 2) * self.step,
        )


@nb.njit(nogil=True, cache=True)
def read(image, place, out):  # pragma: no cover - compiled
    """Add the bilinearly interpolated image at `place` (n, 2) to `out` (n,); 0 outside."""
    h, w = image.shape
    for i in range(out.size):
        x, y = place[i, 0], place[i, 1]
        if x >= 0 and y >= 0 and x < w - 1 and y < h - 1:
            c, r = int(x), int(y)
            fx, fy = x - c, y - r
            upper = (1 - fx) * image[r, c] + fx * image[r, c + 1]
            lower = (1 - fx) * image[r + 1, c] + fx * image[r + 1, c + 1]
            out[i] += (1 - fy) * upper + fy * lower


@nb.njit(nogil=True, cache=True)
def slope(image, place, out):  # pragma: no cover - compiled
    """Write the image's gradient at `place` (n, 2) to `out` (n, 2) [1 / pixel]; 0 outside."""
    h, w = image.shape
    for i in range(out.shape[0]):
        x, y = place[i, 0], place[i, 1]
        out[i, 0] = 0
        out[i, 1] = 0
        if x >= 0 and y >= 0 and x < w - 1 and y < h - 1:
            c, r = int(x), int(y)
            fx, fy = x - c, y - r
            out[i, 0] = (1 - fy) * (image[r, c + 1] - image[r, c]) + fy * (
                image[r + 1, c + 1] - image[r + 1, c]
            )
            out[i, 1] = (1 - fx) * (image[r + 1, c] - image[r, c]) + fx * (
                image[r + 1, c + 1] - image[r, c + 1]
            )


@nb.njit(nogil=True, cache=True)
def add(image, place, values):  # pragma: no cover - compiled
    """Add `values` (n,) to the image's pixels around `place` (n, 2): the transpose of `read`."""
    h, w = image.shape
    for i in range(values.size):
        x, y = place[i, 0], place[i, 1]
        if x >= 0 and y >= 0 and x < w - 1 and y < h - 1:
            c, r = int(x), int(y)
            fx, fy = x - c, y - r
            image[r, c] += (1 - fy) * (1 - fx) * values[i]
            image[r, c + 1] += (1 - fy) * fx * values[i]
            image[r + 1, c] += fy * (1 - fx) * values[i]
            image[r + 1, c + 1] += fy * fx * values[i]
