"""Coverage of errors by the predicted standard deviation and intervals, kept as counts.

Counts of several images add up. Squares are dominated by few pixels, so the median is reported with
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.method import LEVELS, Completed, Image, Mask

_WIDEST = max(LEVELS)  # Level of the widest interval.
_EDGES = np.geomspace(1e-3, 1e3, 601)  # Bins of error over sigma, 2.3 % wide.

Counts = NDArray[np.int64]


def _no_counts() -> Counts:
    return np.zeros(len(_EDGES) + 1, np.int64)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Coverage:
    """Counts over pixels with known truth and sigma."""

    pixels: int = 0
    within: int = 0  # Pixels with an error of at most one sigma.
    within_2: int = 0  # Pixels with an error of at most two sigma.
    square: float = 0.0  # Sum of (error / sigma)^2.
    bins: Counts = field(default_factory=_no_counts)  # Pixels by error / sigma.
    with_interval: int = 0  # Pixels with intervals, and those within each of them.
    inside_68: int = 0
    inside_95: int = 0

    def __add__(self, more: Coverage) -> Coverage:
        """Pool two sets of pixels."""
        names = [item.name for item in fields(self)]
        return Coverage(**{name: getattr(self, name) + getattr(more, name) for name in names})

    def figures(self) -> dict[str, float | int | None]:
        """Return shares of pixels, errors over sigma, and `pixels`; None where unknown.

        `within_sigma` and `within_2_sigma` are shares of pixels with an error of at most one and
        two sigma: 0.68 and 0.95 for normal errors, 0.76 and 0.94 for Laplace errors.
        `rms_over_sigma` is 1 where sigma is correct. `median_over_sigma` is the median of the
        absolute error: 0.67 for normal errors, 0.49 for Laplace errors. `interval_68` and
        `interval_95` are shares of pixels inside the method's intervals.
        """
        return {
            "within_sigma": _share(self.within, self.pixels),
            "within_2_sigma": _share(self.within_2, self.pixels),
            "rms_over_sigma": float(np.sqrt(self.square / self.pixels)) if self.pixels else None,
            "median_over_sigma": self._median(),
            "interval_68": _share(self.inside_68, self.with_interval),
            "interval_95": _share(self.inside_95, self.with_interval),
            "pixels": self.pixels,
        }

    def _median(self) -> float | None:
        if not self.pixels:
            return None
        place = int(np.searchsorted(np.cumsum(self.bins), self.pixels / 2))
        low, high = _EDGES[max(place - 1, 0)], _EDGES[min(place, len(_EDGES) - 1)]
        return float(np.sqrt(low * high))


def _share(count: int, pixels: int) -> float | None:
    return count / pixels if pixels else None


def coverage_by_region(
    completed: Completed, truth_m: Image, valid: Mask, causes: Mapping[str, Mask] | None = None
) -> dict[str, Coverage]:
    """Count holes and pixels with sensor depth separately, and holes by cause.

    Args:
        completed: a method's result.
        truth_m: (h, w) [m], NaN where unknown.
        valid: (h, w) True where the camera has depth.
        causes: cause -> (h, w) pixels of this cause; only holes count.
    """
    parts = {"hole": ~valid, "valid": valid}
    parts |= {f"hole, {cause}": where & ~valid for cause, where in (causes or {}).items()}
    depth_m, sigma_m, half_m = completed.depth_m, completed.sigma_m, completed.half_m
    return {
        name: coverage(depth_m, sigma_m, truth_m, where, half_m) for name, where in parts.items()
    }


def pooled(images: Iterable[Mapping[str, Coverage]]) -> dict[str, Coverage]:
    """Pool the regions of several images or rooms."""
    regions: dict[str, Coverage] = {}
    for image in images:
        for name, part in image.items():
            regions[name] = regions.get(name, Coverage()) + part
    return regions


def coverage(
    depth_m: Image,
    sigma_m: Image,
    truth_m: Image,
    where: Mask,
    half_m: Mapping[int, Image] | None = None,
) -> Coverage:
    """Count over one region.

    Args:
        depth_m: (h, w) completed depth [m].
        sigma_m: (h, w) its predicted standard deviation [m], NaN where the method gives none.
        truth_m: (h, w) [m], NaN where unknown.
        where: (h, w) the region.
        half_m: half-widths of intervals by level, see `Completed`; None: there are none.
    """
    counted = where & np.isfinite(truth_m) & np.isfinite(depth_m) & (sigma_m > 0)
    error = np.abs(depth_m[counted] - truth_m[counted]).astype(np.float64)
    ratio = error / sigma_m[counted]
    halves = {level: half[counted] for level, half in (half_m or {}).items()}
    inside = {level: int(np.count_nonzero(error <= half)) for level, half in halves.items()}
    known = np.isfinite(halves[_WIDEST]) if halves else np.full(0, False)
    return Coverage(
        pixels=int(ratio.size),
        within=int(np.count_nonzero(ratio <= 1)),
        within_2=int(np.count_nonzero(ratio <= 2)),
        square=float((ratio**2).sum()),
        bins=np.bincount(np.searchsorted(_EDGES, ratio), minlength=len(_EDGES) + 1),
        with_interval=int(np.count_nonzero(known)),
        inside_68=inside.get(68, 0),
        inside_95=inside.get(95, 0),
    )
