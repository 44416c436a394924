"""The smoothest inverse depth in holes: a membrane fixed at their rims, torn at image edges.

Minimises the sum of w (x_i - x_j)^2 over neighbouring pixels, where x is inverse depth and w is
small at image edges. Valid pixels are fixed. This is a Poisson problem without sources. Where w is
constant the solution is harmonic, so that a plane, linear in inverse depth, is extended exactly.
Cf. Levin, Lischinski and Weiss, Colorization using optimization, SIGGRAPH 2004, which the NYU data
set uses to fill its depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from starling.learning.completion.classical.outcome import completed, guide, inverse, trusted
from starling.learning.completion.frame import CompletionFrame, Image, Mask
from starling.learning.completion.method import Completed
from starling.patterns.errors import in_interval


@dataclass(frozen=True, kw_only=True, slots=True)
class Poisson:
    """Membrane with weights w = exp(-(step / sigma_level)^2 / 2), step the image's difference."""

    # Sigma of the greatest difference of a channel between neighbours [of 255].
    sigma_level: float = 2.0
    least: float = 1e-3  # Weight across the sharpest edge, so that every hole has a rim.
    guide_smoothing_px: float = 1.5  # Sigma of the Gaussian smoothing of the guide image.

    def __post_init__(self) -> None:
        in_interval("sigma_level", self.sigma_level, 0.1, 1000.0)
        in_interval("least", self.least, 1e-6, 1.0)
        in_interval("guide_smoothing_px", self.guide_smoothing_px, 0.0, 50.0)

    @property
    def name(self) -> str:
        """`poisson`."""
        return "poisson"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay as they are."""
        image = guide(frame, self.guide_smoothing_px).astype(np.float32)
        across, down = (self._weight(image, axis) for axis in (1, 0))
        fixed = trusted(frame)
        filled = _membrane(inverse(frame.depth_m, fixed), fixed, across, down)
        return completed(frame, 1 / filled)

    def _weight(self, image: Image, axis: int) -> NDArray[np.float64]:
        """Return the weight of each pixel and the next along an axis."""
        step = np.abs(np.diff(image, axis=axis)).max(axis=2).astype(np.float64)
        return np.maximum(np.exp(-((step / self.sigma_level) ** 2) / 2), self.least)


def _membrane(
    values: Image, fixed: Mask, across: NDArray[np.float64], down: NDArray[np.float64]
) -> Image:
    """Solve for the free pixels by a direct solver, so that results are reproducible."""
    number = np.full(fixed.shape, -1)
    number[~fixed] = np.arange(np.count_nonzero(~fixed))
    size = number.max() + 1
    diagonal, pull = np.zeros(size), np.zeros(size)
    entries: list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]] = []
    horizontal = ((slice(None), slice(None, -1)), (slice(None), slice(1, None)), across)
    vertical = ((slice(None, -1), slice(None)), (slice(1, None), slice(None)), down)
    for first, second, weight in (horizontal, vertical):
        for pixel, neighbour in ((first, second), (second, first)):
            free = ~fixed[pixel]
            row, column, w = number[pixel][free], number[neighbour][free], weight[free]
            np.add.at(diagonal, row, w)
            rim = column < 0
            np.add.at(pull, row[rim], w[rim] * values[neighbour][free][rim])
            entries.append((row[~rim], column[~rim], -w[~rim]))
    rows, columns, weights = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = sparse.csc_array((weights, (rows, columns)), shape=(size, size))
    matrix = sparse.csc_array(matrix + sparse.diags_array(diagonal))
    # The matrix is symmetric and positive definite: no pivoting is needed.
    factors = linalg.splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    out = values.astype(np.float64)
    out[~fixed] = factors.solve(pull)
    return out.astype(np.float32)
