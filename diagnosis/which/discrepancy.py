"""Discrepancy of the matcher: what depth by matchers of other makes has in common.

No setting of our matcher turns it into another make. Its settings then explain a part of the gap by
chance. The captured images, matched by several makes, show what any other make may change. An
effect has to explain what they do not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features.depth import matched_depth_features
from starling.diagnosis.scenes.observation import (
    StereoObservation,
    expect,
    match_pairs,
    quantise_depth,
)
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which.fit import Folds, fit
from starling.diagnosis.which.likelihood import Likelihood, total_size
from starling.diagnosis.which.makes import other_makes
from starling.diagnosis.which.null import gain_threshold
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Columns, FeatureTable, Row, Rows, on_scenes
from starling.sim.sensor.matcher import Matcher

_COARSE_STEPS, _FINE_STEPS = 4, 16  # Positions tried between two nodes.
_AGAINST_CAPTURE = "unlike"  # Features relative to the captured depth, unknown for other makes.
_TINY = 1e-9  # Least size of a direction.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Discrepancy:
    """Changes of the features by other makes of matcher, on the captured images."""

    changes: NDArray[np.float64]  # (makes, scenes, features); NaN where unknown.

    def without(self, number: int) -> Discrepancy:
        """Leave out one make."""
        return Discrepancy(changes=np.delete(self.changes, number, axis=0))

    @property
    def spread(self) -> Row:
        """Root mean square of the changes by feature; 1 where no make changes it."""
        spread = np.sqrt((np.nan_to_num(self.changes) ** 2).mean(axis=(0, 1)))
        return np.where(spread > _TINY, spread, 1.0)

    def remove(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Remove from changes (..., scenes, features) what a mixture of the makes explains.

        All scenes share the weights of the mixture, which are normal with variance 1.
        """
        spread = self.spread
        makes = _flat(self.changes / spread)
        whole = _flat(change / spread)
        mixture = np.linalg.solve(makes @ makes.T + np.eye(len(makes)), makes @ whole.T).T
        rest = (whole - mixture @ makes).reshape(change.shape) * spread
        return np.where(np.isfinite(change), rest, np.nan)

    @property
    def leftover(self) -> Row:
        """Deviation (features,) of one make from mixtures of the others."""
        rests = [self.without(number).remove(change) for number, change in enumerate(self.changes)]
        return np.sqrt((np.nan_to_num(np.stack(rests)) ** 2).mean(axis=(0, 1)))

    def likelihood(self, gap: Rows, plain: Likelihood) -> Likelihood:
        """Build the likelihood of what the makes do not explain of a gap.

        The leftover is scaled by the size of the gap over that of the makes.

        Args:
            gap: (scenes, features) gap of the device's depth.
            plain: likelihood without discrepancy; gives deviations and weights.
        """
        known = np.isfinite(gap) & np.isfinite(self.changes).all(axis=0)
        gap = np.where(known, gap, np.nan)
        sizes = [total_size(change / plain.deviation, plain.weight) for change in self.changes]
        scale = total_size(gap / plain.deviation, plain.weight) / max(np.mean(sizes), _TINY)
        deviation = np.sqrt(plain.deviation**2 + scale * self.leftover**2)
        return Likelihood(self.remove(gap), deviation, plain.weight)

    def gains(
        self,
        signatures: Sequence[Signature],
        gap: Rows,
        plain: Likelihood,
        folds: Folds,
        *,
        steps: int,
    ) -> dict[str, float]:
        """Compute the held-out gain of each effect in what the makes do not explain.

        Args:
            signatures: signatures of effects.
            gap: as `likelihood`.
            plain: as `likelihood`.
            folds: masks of held-out scenes.
            steps: positions tried between two nodes.
        """
        likelihood = self.likelihood(gap, plain)
        rests = (
            dataclasses.replace(signature, change=self.remove(signature.change))
            for signature in signatures
        )
        return {rest.name: fit(rest, likelihood, folds, steps=steps).total for rest in rests}

    def threshold(self, signatures: Sequence[Signature], plain: Likelihood, folds: Folds) -> float:
        """Return the largest gain of any effect where the device is one of the makes.

        Args:
            signatures: all candidates.
            plain: as `likelihood`.
            folds: masks of held-out scenes.
        """
        gains = [
            gain
            for number, change in enumerate(self.changes)
            for gain in self.without(number)
            .gains(signatures, change, plain, folds, steps=_COARSE_STEPS)
            .values()
        ]
        return gain_threshold(np.array(gains))


def gains_beyond_makes(
    table: FeatureTable,
    base: Rows,
    likelihood: Likelihood,
    folds: Folds,
    accepted: Sequence[Signature],
    candidates: Sequence[Signature],
) -> tuple[dict[str, float], float]:
    """Compute what accepted effects explain beyond matchers of other makes.

    Args:
        table: feature table of the matching segment.
        base: features by our matcher.
        likelihood: likelihood of the gap.
        folds: masks of held-out scenes.
        accepted: signatures of accepted effects.
        candidates: signatures of all effects.

    Returns:
        Held-out gain by effect, and its threshold.
    """
    makes = other_makes(table.scene_models[0].sensor.matcher)
    work = (table.scene_models, table.pool, row_of_make, table.columns)
    rows = np.array([on_scenes(*work, make) for make in makes])
    discrepancy = Discrepancy(changes=rows - base)
    gains = discrepancy.gains(accepted, likelihood.gap, likelihood, folds, steps=_FINE_STEPS)
    return gains, discrepancy.threshold(candidates, likelihood, folds)


def row_of_make(scene: SceneModel, columns: Columns, make: Matcher) -> Row:
    """Compute the features of the first captured pair, matched by another make.

    Features in time and those relative to the captured depth are unknown.
    """
    pair = expect(scene.real, StereoObservation).first_repeats(1)
    sensor = dataclasses.replace(scene.sensor, matcher=make)
    device_px = quantise_depth(match_pairs(pair.left, pair.right, sensor), sensor)
    values = matched_depth_features(pair.with_depth(device_px), scene.strata, device_px[0])
    known = {name: value for name, value in values.items() if not name.startswith(_AGAINST_CAPTURE)}
    return columns.row(known)


def _flat(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Arrange scenes and features in a row (..., scenes * features); 0 where unknown."""
    return np.nan_to_num(changes).reshape(*changes.shape[:-2], -1)
