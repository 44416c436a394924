"""Lower bounds for every method: a camera without holes, and the angle of incidence alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.learning.data.example import Example, Image, check_learnable, known_holes
from starling.learning.methods import model_file
from starling.patterns.errors import refuse
from starling.sim.arrays import filled
from starling.sim.console import progress
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import NORMAL_RADIUS_PX, fit_planes, incidence_cosine


@dataclass(frozen=True, slots=True)
class PerfectPredictor:
    """Predicts depth everywhere."""

    def probability(self, example: Example) -> Image:
        """0 everywhere, (h, w)."""
        return np.zeros(example.depth_m.shape, np.float32)


@dataclass(frozen=True, slots=True)
class Perfect:
    """The lower bound for every method; there is nothing to train."""

    name: ClassVar[str] = "perfect"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> PerfectPredictor:
        """Do nothing; no file is written."""
        del examples, folder, seed, track
        return PerfectPredictor()

    def load(self, folder: Path) -> PerfectPredictor:
        """Return the predictor; no file is read."""
        del folder
        return PerfectPredictor()


_VERSION = 1
_BINS = 180  # Bins of half a degree.


def incidence_deg(example: Example) -> Image:
    """Return the angle between the normal and the ray to the left imager (h, w) [deg], 0 to 90.

    Windows of 7 px extend across depth edges, which therefore count as grazing. This matches the
    source, whose reconstructed meshes are closed behind edges. Without it the rule is worse.

    Raises:
        InputError: if no reference depth is known.
    """
    known = np.isfinite(example.depth_m)
    disparity = filled(example.info.disparity_px(example.depth_m), known)
    planes = fit_planes(disparity, known, NORMAL_RADIUS_PX)
    return np.rad2deg(np.arccos(incidence_cosine(planes, Pinhole.from_camera(example.info))))


@dataclass(frozen=True, slots=True, eq=False)
class SimplePredictor:
    """Probability as an increasing function of the angle of incidence."""

    angle_deg: NDArray[np.float64]  # (k,) ascending.
    share: NDArray[np.float64]  # (k,) probability at the angle, ascending; interpolated linearly.

    def probability(self, example: Example) -> Image:
        """Return the probability of each pixel's angle, (h, w).

        Raises:
            InputError: if no reference depth is known.
        """
        return np.interp(incidence_deg(example), self.angle_deg, self.share).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Simple:
    """Isotonic regression of the probability on the angle; each scene has the same weight."""

    name: ClassVar[str] = "simple"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> SimplePredictor:
        """Count holes by angle and fit an increasing share; nothing is random.

        Raises:
            InputError: if the examples cannot be learnt from (`starling.learning.data.example`).
        """
        del seed
        check_learnable(examples)
        holes, pixels = np.zeros(_BINS), np.zeros(_BINS)
        edges = np.linspace(0, 90, _BINS + 1)
        for example in track(examples, "incidence"):
            ndp, counted = known_holes(example)
            angle = incidence_deg(example)
            weight = 1 / np.count_nonzero(counted)
            pixels += weight * np.histogram(angle[counted], edges)[0]
            holes += weight * np.histogram(angle[counted & ndp], edges)[0]
        occupied = pixels > 0
        share = optimize.isotonic_regression(
            holes[occupied] / pixels[occupied], weights=pixels[occupied]
        ).x
        centre = (edges[:-1] + edges[1:])[occupied] / 2
        predictor = SimplePredictor(centre, np.asarray(share, np.float64))
        arrays = {"angle_deg": predictor.angle_deg, "share": predictor.share}
        model_file.write(folder, self.name, _VERSION, arrays)
        return predictor

    def load(self, folder: Path) -> SimplePredictor:
        """Load the result of `fit`.

        Raises:
            InputError: if there is none, or it is damaged or of another version.
        """
        arrays = model_file.read(folder, self.name, _VERSION)
        angle, share = model_file.take(arrays, {"angle_deg": "f1", "share": "f1"}, folder)
        increasing = angle.size and np.all(np.diff(angle) > 0) and np.all(np.diff(share) >= 0)
        if angle.shape != share.shape or not (increasing and 0 <= share[0] <= share[-1] <= 1):
            advice = "It is damaged: train again."
            raise refuse("model", "must be whole", f"{folder} with another share", advice)
        return SimplePredictor(angle, share)
