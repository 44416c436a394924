"""Figures of completed depth against truth, kept as sums, so that images can be pooled.

Which pixels count: those whose truth is known. One that the method leaves without depth (NaN,
infinite or not above zero) is missing: it fails every delta, and the errors, which cannot be had
of it, are of the others alone; `missing` is printed beside them for that reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Image, Mask
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
"""Figure -> the ratio of depth and truth, either way round, that its pixels are below."""

Figures = dict[str, float | int | None]


@dataclass(frozen=True, kw_only=True, slots=True)
class Sums:
    """What is summed over counted pixels; sums of several images add up to those of all."""

    pixels: int = 0  # Counted.
    missing: int = 0  # Of them, those the method has no depth of.
    error_m: float = 0.0  # Of |d - z| [m], z the truth; this and the next three: not over missing.
    square_m2: float = 0.0  # Of (d - z)^2 [m^2].
    relative: float = 0.0  # Of |d - z| / z.
    square_relative_m: float = 0.0  # Of (d - z)^2 / z [m].
    within: tuple[int, ...] = (0,) * len(RATIOS)  # Pixels below each of `RATIOS`.

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
        """Divide: `mae_m`, `rmse_m`, `absrel`, `sqrel` [m], `RATIOS`, and the two counts.

        AbsRel, SqRel, RMSE and deltas as Eigen et al., Depth map prediction from a single image
        using a multi-scale deep network, NIPS 2014, section 4.3. None where no pixel is left.
        """
        given = self.pixels - self.missing
        square = _share(self.square_m2, given)
        return {
            "mae_m": _share(self.error_m, given),
            "rmse_m": None if square is None else float(np.sqrt(square)),
            "absrel": _share(self.relative, given),
            "sqrel": _share(self.square_relative_m, given),
            **{
                name: _share(count, self.pixels)
                for name, count in zip(RATIOS, self.within, strict=True)
            },
            "pixels": self.pixels,
            "missing": self.missing,
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class Score:
    """Sums of one image, or of several, by region."""

    all: Sums = field(default_factory=Sums)
    hole: Sums = field(default_factory=Sums)  # Where the camera has no depth.
    valid: Sums = field(default_factory=Sums)  # Where it has.
    edge: Sums = field(default_factory=Sums)  # Near the truth's depth edges.
    reasons: Mapping[str, Sums] = field(default_factory=dict)  # Holes by their cause.

    def __add__(self, other: Score) -> Score:
        """Pool two; a cause that one of them lacks counts as no pixels."""
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
        """`all`, `hole`, `valid`, `edge` and `reasons`, which holds the figures of each cause."""
        return {
            "all": self.all.figures(),
            "hole": self.hole.figures(),
            "valid": self.valid.figures(),
            "edge": self.edge.figures(),
            "reasons": {cause: sums.figures() for cause, sums in self.reasons.items()},
        }


def answered(depth_m: NDArray[np.floating]) -> Mask:
    """Where a method says something: a depth that is finite and above zero."""
    return np.isfinite(depth_m) & (depth_m > 0)


def sums(depth_m: Image, truth_m: Image, where: Mask) -> Sums:
    """Sum over one region.

    Args:
        depth_m: (h, w) what the method says [m].
        truth_m: (h, w) [m], NaN where unknown.
        where: (h, w) the region.

    Raises:
        InputError: if shapes differ, or a known truth is not above zero.
    """
    if not depth_m.shape == truth_m.shape == where.shape:
        got = f"{depth_m.shape}, {truth_m.shape} and {where.shape}"
        raise refuse("depth_m, truth_m and where", "must share one shape", got, "Take one view's.")
    counted = where & np.isfinite(truth_m)
    truth = truth_m[counted].astype(np.float64)
    if not (truth > 0).all():
        raise refuse("truth_m", "must be > 0 where known", truth.min(), "Mark unknown with NaN.")
    found = depth_m[counted].astype(np.float64)
    given = answered(found)
    z, d = truth[given], found[given]
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
    """Compare the completed depth of one image with the truth, region by region.

    Args:
        depth_m: (h, w) completed [m]; NaN where the method has none.
        truth_m: (h, w) [m], NaN where unknown.
        valid: (h, w) where the camera itself has depth.
        focal_baseline_px_m: of the camera: a depth edge is a step of over 1 px of disparity, and
            its pixels are those nearby, as everywhere (`starling.sim.metrics.depth_edges`).
        causes: cause -> (h, w) pixels that it is of; only holes count there.

    Raises:
        InputError: as `sums`, or if focal length times baseline is not above zero.
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


def pooled(scores: Iterable[Score]) -> Score:
    """Take all pixels of all images as one: every pixel counts alike, large holes much."""
    return sum(scores, Score())


def averaged(regions: Iterable[Sums]) -> Figures:
    """Average the figures of one region: images count alike, or rooms where each is pooled first.

    Where one has no such pixel, it does not count; the two counts are added up.
    """
    parts = list(regions)
    rows = [part.figures() for part in parts]
    counts = sum(parts, Sums())
    means = {name: _mean([row[name] for row in rows]) for name in Sums().figures()}
    return {**means, "pixels": counts.pixels, "missing": counts.missing}


def _share(total: float, count: int) -> float | None:
    return float(total) / count if count else None


def _mean(values: list[float | int | None]) -> float | None:
    known: NDArray[np.float64] = np.array([one for one in values if one is not None], np.float64)
    return float(known.mean()) if known.size else None
