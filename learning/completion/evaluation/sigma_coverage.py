"""How often completed depth lies as near the truth as the method says that it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.learning.completion.frame import Image, Mask
from starling.learning.completion.method import Completed


@dataclass(frozen=True, kw_only=True, slots=True)
class Coverage:
    """Counts over pixels whose truth and sigma are known; those of several images add up."""

    pixels: int = 0
    within: int = 0  # Off by no more than one sigma.
    square: float = 0.0  # Of error over sigma, summed.

    def __add__(self, other: Coverage) -> Coverage:
        """Pool two sets of pixels."""
        return Coverage(
            pixels=self.pixels + other.pixels,
            within=self.within + other.within,
            square=self.square + other.square,
        )

    def figures(self) -> dict[str, float | int | None]:
        """`within_sigma`, the share off by no more than one sigma (0.68 of a normal error, 0.76 of
        Laplace's), `rms_over_sigma` (1 where sigma is right), and `pixels`.
        """
        if not self.pixels:
            return {"within_sigma": None, "rms_over_sigma": None, "pixels": 0}
        return {
            "within_sigma": self.within / self.pixels,
            "rms_over_sigma": float(np.sqrt(self.square / self.pixels)),
            "pixels": self.pixels,
        }


def of_regions(found: Completed, truth_m: Image, valid: Mask) -> dict[str, Coverage]:
    """Count holes, and where the camera has depth, apart.

    Args:
        found: what a method makes of a frame.
        truth_m: (h, w) [m], NaN where unknown.
        valid: (h, w) where the camera has depth.
    """
    parts = {"hole": ~valid, "valid": valid}
    return {
        name: coverage(found.depth_m, found.sigma_m, truth_m, where)
        for name, where in parts.items()
    }


def coverage(depth_m: Image, sigma_m: Image, truth_m: Image, where: Mask) -> Coverage:
    """Count over one region.

    Args:
        depth_m: (h, w) what the method says [m].
        sigma_m: (h, w) the standard deviation that it expects of that [m], NaN where it tells none.
        truth_m: (h, w) [m], NaN where unknown.
        where: (h, w) the region.
    """
    counted = where & np.isfinite(truth_m) & np.isfinite(depth_m) & (sigma_m > 0)
    off = np.abs(depth_m[counted] - truth_m[counted]).astype(np.float64) / sigma_m[counted]
    return Coverage(
        pixels=int(off.size),
        within=int(np.count_nonzero(off <= 1)),
        square=float((off**2).sum()),
    )
