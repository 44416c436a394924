"""Metrics of completed depth against ground truth, kept as sums so that images can be pooled.

Pixels with known truth count. A pixel is missing if the method gives no depth (NaN, infinite or not
above zero). Missing pixels fail every delta and are excluded from the errors, so `missing` is
reported with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.evaluation.coverage import Coverage as Coverage
from starling.learning.completion.evaluation.coverage import coverage as coverage
from starling.learning.completion.evaluation.coverage import (
    coverage_by_region as coverage_by_region,
)
from starling.learning.completion.method import Image, Mask
from starling.patterns.errors import positive, refuse
from starling.sim.metrics import depth_edges
from starling.sim.stereo.depth import disparity_from_depth

RATIOS: dict[str, float] = {
    "delta1": 1.25,
    "delta2": 1.25**2,
    "delta3": 1.25**3,
    "delta105": 1.05,
    "delta110": 1.10,
    "delta125": 1.25,
}
"""Metric -> upper bound of max(depth / truth, truth / depth)."""

Figures = dict[str, float | int | None]


@dataclass(frozen=True, kw_only=True, slots=True)
class Sums:
    """Sums over counted pixels. Sums of several images add up."""

    pixels: int = 0  # Counted pixels.
    missing: int = 0  # Counted pixels without depth.
    # Sums over pixels that are not missing; d is depth and z the truth.
    error_m: float = 0.0  # |d - z| [m].
    square_m2: float = 0.0  # (d - z)^2 [m^2].
    relative: float = 0.0  # |d - z| / z.
    square_relative_m: float = 0.0  # (d - z)^2 / z [m].
    within: tuple[int, ...] = (0,) * len(RATIOS)  # Number of pixels below each of `RATIOS`.

    def __add__(self, other: Sums) -> Sums:
        """Pool two sets of pixels."""
        return Sums(
            pixels=self.pixels + other.pixels,
            missing=self.missing + other.missing,
            error_m=self.error_m + other.error_m,
            square_m2=self.square_m2 + other.square_m2,
            relative=self.relative + other.relative,
            square_relative_m=self.square_relative_m + other.square_relative_m,
            within=tuple(a + b for a, b in zip(self.within, other.within, strict=True)),
        )

    def figures(self) -> Figures:
        """Return `mae_m`, `rmse_m`, `absrel`, `sqrel` [m], `RATIOS`, and the two counts.

        AbsRel, SqRel, RMSE and deltas as in Eigen et al., Depth map prediction from a single image
        using a multi-scale deep network, NIPS 2014, section 4.3. None where there is no pixel.
        """
        present = self.pixels - self.missing
        square = _share(self.square_m2, present)
        return {
            "mae_m": _share(self.error_m, present),
            "rmse_m": None if square is None else float(np.sqrt(square)),
            "absrel": _share(self.relative, present),
            "sqrel": _share(self.square_relative_m, present),
            **{
                name: _share(count, self.pixels)
                for name, count in zip(RATIOS, self.within, strict=True)
            },
            "pixels": self.pixels,
            "missing": self.missing,
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class Score:
    """Sums of one or several images, by region."""

    all: Sums = field(default_factory=Sums)
    hole: Sums = field(default_factory=Sums)  # Pixels where the camera has no depth.
    valid: Sums = field(default_factory=Sums)  # Pixels where the camera has depth.
    edge: Sums = field(default_factory=Sums)  # Pixels near depth edges of the truth.
    reasons: Mapping[str, Sums] = field(default_factory=dict)  # Holes by cause.

    def __add__(self, other: Score) -> Score:
        """Pool two scores. A cause that one of them lacks counts as no pixels."""
        causes = sorted({*self.reasons, *other.reasons})
        return Score(
            all=self.all + other.all,
            hole=self.hole + other.hole,
            valid=self.valid + other.valid,
            edge=self.edge + other.edge,
            reasons={
                cause: self.reasons.get(cause, Sums()) + other.reasons.get(cause, Sums())
                for cause in causes
            },
        )

    def figures(self) -> dict[str, Figures | dict[str, Figures]]:
        """Return the metrics by region, with those of each cause in `reasons`."""
        return {
            "all": self.all.figures(),
            "hole": self.hole.figures(),
            "valid": self.valid.figures(),
            "edge": self.edge.figures(),
            "reasons": {cause: sums.figures() for cause, sums in self.reasons.items()},
        }


def has_depth(depth_m: NDArray[np.floating]) -> Mask:
    """Return where a method gives depth: finite and above zero."""
    return np.isfinite(depth_m) & (depth_m > 0)


def sums(depth_m: Image, truth_m: Image, where: Mask) -> Sums:
    """Sum over one region.

    Args:
        depth_m: (h, w) completed depth [m].
        truth_m: (h, w) [m], NaN where unknown.
        where: (h, w) the region.

    Raises:
        InputError: if shapes differ, or a known truth is not above zero.
    """
    if not depth_m.shape == truth_m.shape == where.shape:
        got = f"{depth_m.shape}, {truth_m.shape} and {where.shape}"
        advice = "Give all three of one view."
        raise refuse("depth_m, truth_m and where", "must share one shape", got, advice)
    counted = where & np.isfinite(truth_m)
    truth = truth_m[counted].astype(np.float64)
    if not (truth > 0).all():
        raise refuse("truth_m", "must be > 0 where known", truth.min(), "Mark unknown with NaN.")
    depth = depth_m[counted].astype(np.float64)
    present = has_depth(depth)
    z, d = truth[present], depth[present]
    error = np.abs(d - z)
    ratio = np.maximum(d / z, z / d)
    return Sums(
        pixels=truth.size,
        missing=int(truth.size - z.size),
        error_m=float(error.sum()),
        square_m2=float((error**2).sum()),
        relative=float((error / z).sum()),
        square_relative_m=float((error**2 / z).sum()),
        within=tuple(int(np.count_nonzero(ratio < most)) for most in RATIOS.values()),
    )


def score(
    depth_m: Image,
    truth_m: Image,
    valid: Mask,
    *,
    focal_baseline_px_m: float,
    causes: Mapping[str, Mask] | None = None,
) -> Score:
    """Compare the completed depth of one image with the truth by region.

    Args:
        depth_m: (h, w) completed depth [m]; NaN where the method gives none.
        truth_m: (h, w) [m], NaN where unknown.
        valid: (h, w) True where the camera itself has depth.
        focal_baseline_px_m: focal length times baseline of the camera. A depth edge is a step of
            more than 1 px of disparity (`starling.sim.metrics.depth_edges`).
        causes: cause -> (h, w) pixels of this cause; only holes count.

    Raises:
        InputError: see `sums`; or if focal length times baseline is not above zero.
    """
    positive("focal_baseline_px_m", focal_baseline_px_m)
    everywhere = np.ones(truth_m.shape, bool)
    disparity = disparity_from_depth(truth_m, focal_px=focal_baseline_px_m, baseline_m=1.0)
    return Score(
        all=sums(depth_m, truth_m, everywhere),
        hole=sums(depth_m, truth_m, ~valid),
        valid=sums(depth_m, truth_m, valid),
        edge=sums(depth_m, truth_m, depth_edges(disparity)),
        reasons={
            cause: sums(depth_m, truth_m, mask & ~valid) for cause, mask in (causes or {}).items()
        },
    )


def pool(scores: Iterable[Score]) -> Score:
    """Pool all pixels of all images. Every pixel has the same weight."""
    return sum(scores, Score())


def average(regions: Iterable[Sums]) -> Figures:
    """Average the metrics of one region over images, or over rooms if each is pooled first.

    Images without such a pixel do not count. The two counts are summed.
    """
    parts = list(regions)
    rows = [part.figures() for part in parts]
    counts = sum(parts, Sums())
    means = {name: _mean([row[name] for row in rows]) for name in Sums().figures()}
    return {**means, "pixels": counts.pixels, "missing": counts.missing}


def _share(total: float, count: int) -> float | None:
    return float(total) / count if count else None


def _mean(values: list[float | int | None]) -> float | None:
    known: NDArray[np.float64] = np.array(
        [value for value in values if value is not None], np.float64
    )
    return float(known.mean()) if known.size else None
