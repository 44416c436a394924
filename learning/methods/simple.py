"""The simple rule: the more a surface is seen at a grazing angle, the likelier is a hole.

Source: the "simple NDP prediction scheme" of A Supervised Approach to Predicting Noise in Depth
Images, sec. IV-B: normals too perpendicular to the view direction have no depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.learning.data.example import Example, Image
from starling.learning.data.learnable import check_learnable, known_holes
from starling.learning.methods import model_file
from starling.sim.console import progress
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import NORMAL_RADIUS_PX, fit_planes, incidence_cosine
from starling.sim.stereo.filled import filled

_VERSION = 1
_BINS = 180  # Half a degree each.


def incidence_deg(example: Example) -> Image:
    """Angle between the normal and the ray to the left imager (h, w) [deg], 0 to 90.

    Windows of 7 px reach across depth edges, which so count as grazing, as on the reconstructed
    meshes of the source, whose surfaces close behind edges. Without that the rule is worse.

    Raises:
        InputError: if nothing is known of the reference.
    """
    known = np.isfinite(example.depth_m)
    disparity = filled(example.info.disparity_px(example.depth_m), known)
    planes = fit_planes(disparity, known, NORMAL_RADIUS_PX)
    return np.rad2deg(np.arccos(incidence_cosine(planes, Pinhole.of(example.info))))


@dataclass(frozen=True, slots=True, eq=False)
class SimplePredictor:
    """Probability as a rising function of the angle of incidence."""

    angle_deg: NDArray[np.float64]  # (k,) ascending.
    share: NDArray[np.float64]  # (k,) probability there, ascending; straight between.

    def probability(self, example: Example) -> Image:
        """Look up each pixel's angle, (h, w).

        Raises:
            InputError: if nothing is known of the reference.
        """
        return np.interp(incidence_deg(example), self.angle_deg, self.share).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Simple:
    """Grazing normals, scaled to a probability by isotonic regression; scenes count alike."""

    name: ClassVar[str] = "simple"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> SimplePredictor:
        """Count holes by angle and make the shares rise; nothing is drawn.

        Raises:
            InputError: if nothing can be learnt from the examples (`starling.learning.data.learnable`).
        """
        del seed
        check_learnable(examples)
        holes, pixels = np.zeros(_BINS), np.zeros(_BINS)
        edges = np.linspace(0, 90, _BINS + 1)
        for example in track(examples, "incidence"):
            ndp, counted = known_holes(example)
            angle = incidence_deg(example)
            each = 1 / np.count_nonzero(counted)
            pixels += each * np.histogram(angle[counted], edges)[0]
            holes += each * np.histogram(angle[counted & ndp], edges)[0]
        met = pixels > 0
        share = optimize.isotonic_regression(holes[met] / pixels[met], weights=pixels[met]).x
        centre = (edges[:-1] + edges[1:])[met] / 2
        learnt = SimplePredictor(centre, np.asarray(share, np.float64))
        arrays = {"angle_deg": learnt.angle_deg, "share": learnt.share}
        model_file.write(folder, self.name, _VERSION, arrays)
        return learnt

    def load(self, folder: Path) -> SimplePredictor:
        """Read what `fit` has left in its folder.

        Raises:
            InputError: if there is nothing, or it is damaged or of another version.
        """
        arrays = model_file.read(folder, self.name, _VERSION)
        return SimplePredictor(*model_file.take(arrays, ("angle_deg", "share"), folder))
