"""Coverage of the errors by the standard deviation that a method predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.learning.completion.frame import Image, Mask
from starling.learning.completion.method import Completed


@dataclass(frozen=True, kw_only=True, slots=True)
class Coverage:
    """Counts over pixels with known truth and sigma. Counts of several images add up."""

    pixels: int = 0
    within: int = 0  # Pixels with an error of at most one sigma.
    square: float = 0.0  # Sum of (error / sigma)^2.

    def __add__(self, other: Coverage) -> Coverage:
        """Pool two sets of pixels."""
        return Coverage(
            pixels=self.pixels + other.pixels,
            within=self.within + other.within,
            square=self.square + other.square,
        )

    def figures(self) -> dict[str, float | int | None]:
        """Return `within_sigma`, `rms_over_sigma` and `pixels`.

        `within_sigma` is the share of pixels with an error of at most one sigma: 0.68 for normal
        errors, 0.76 for Laplace errors. `rms_over_sigma` is 1 where sigma is correct.
        """
        if not self.pixels:
            return {"within_sigma": None, "rms_over_sigma": None, "pixels": 0}
        return {
            "within_sigma": self.within / self.pixels,
            "rms_over_sigma": float(np.sqrt(self.square / self.pixels)),
            "pixels": self.pixels,
        }


def coverage_by_region(completed: Completed, truth_m: Image, valid: Mask) -> dict[str, Coverage]:
    """Count holes and pixels with sensor depth separately.

    Args:
        completed: a method's result.
        truth_m: (h, w) [m], NaN where unknown.
        valid: (h, w) True where the camera has depth.
    """
    parts = {"hole": ~valid, "valid": valid}
    return {
        name: coverage(completed.depth_m, completed.sigma_m, truth_m, where)
        for name, where in parts.items()
    }


def coverage(depth_m: Image, sigma_m: Image, truth_m: Image, where: Mask) -> Coverage:
    """Count over one region.

    Args:
        depth_m: (h, w) completed depth [m].
        sigma_m: (h, w) its predicted standard deviation [m], NaN where the method gives none.
        truth_m: (h, w) [m], NaN where unknown.
        where: (h, w) the region.
    """
    counted = where & np.isfinite(truth_m) & np.isfinite(depth_m) & (sigma_m > 0)
    ratio = np.abs(depth_m[counted] - truth_m[counted]).astype(np.float64) / sigma_m[counted]
    return Coverage(
        pixels=int(ratio.size),
        within=int(np.count_nonzero(ratio <= 1)),
        square=float((ratio**2).sum()),
    )
