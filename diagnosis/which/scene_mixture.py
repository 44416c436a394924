"""What remains of a gap on the images once the scenes may differ from their description.

Light, surfaces and exposure differ from scene to scene, and no base describes them completely. What
no mixture of effects on the scene explains comes from the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.likelihood import LARGEST, Likelihood, total_size
from starling.diagnosis.which.null import BaseSamples, leave_one_out
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Rows
from starling.sim.effects.effect import Stage

# A gap remains beyond the scenes if it exceeds noise size + allowance + a share of the initial gap.
ALLOWANCE = 0.1
SHARE_OF_INITIAL = 0.005
_ALSO = ("exposure", "spot_shape")  # No base has the exact spot; each scene has its exposure.


@dataclass(frozen=True, slots=True, eq=False)
class SceneMixture:
    """Changes of the features by effects on the scene."""

    changes: NDArray[np.float64]  # (changes, scenes, features) over the deviation; 0 where unknown.
    weight: NDArray[np.float64]  # (features,)

    @classmethod
    def from_signatures(
        cls, signatures: Sequence[Signature], likelihood: Likelihood
    ) -> SceneMixture:
        """Select the effects on the scene, each at all of its simulated values.

        Args:
            signatures: signatures of all candidates.
            likelihood: gives deviations and feature weights.
        """
        empty = np.empty((0, *likelihood.gap.shape))
        selected = [
            each.change
            for each in signatures
            if each.candidate.effect.stage is Stage.SCENE or each.candidate.effect.name in _ALSO
        ]
        changes = np.concatenate([empty, *selected]) / likelihood.deviation
        return cls(np.nan_to_num(changes), likelihood.weight)

    def remove(self, residual: Rows) -> Rows:
        """Remove from each scene the mixture that explains most of it.

        The amounts are normal with variance 1 and differ from scene to scene.

        Args:
            residual: (scenes, features) gap over its deviation; NaN where unknown.
        """
        known = np.isfinite(residual)
        rest = np.full_like(residual, np.nan)
        for number, inside in enumerate(known):
            changes, weight = self.changes[:, number, inside], self.weight[inside]
            left = residual[number, inside]
            clipped = np.clip(left, -np.sqrt(LARGEST), np.sqrt(LARGEST))
            weighted = changes * weight
            amounts = np.linalg.solve(
                weighted @ changes.T + np.eye(len(changes)), weighted @ clipped
            )
            rest[number, inside] = left - amounts @ changes
        return rest

    def size(self, residual: Rows) -> float:
        """Compute the size of what the mixtures leave."""
        return total_size(self.remove(residual), self.weight)


def remains_beyond_scenes(
    signatures: Sequence[Signature], base: BaseSamples, likelihood: Likelihood, unexplained: Rows
) -> bool:
    """Whether effects leave a gap that no mixture of effects on the scene explains.

    Args:
        signatures: signatures of all candidates.
        base: samples of the base.
        likelihood: likelihood of the gap.
        unexplained: (scenes, features) what the accepted effects leave, from
            `Likelihood.unexplained`.
    """
    mixture = SceneMixture.from_signatures(signatures, likelihood)
    seeds = [part.likelihood(capture, mixture.weight) for part, capture in leave_one_out(base)]
    noise = max(mixture.size(each.residual(each.no_change)) for each in seeds)
    before = likelihood.size(likelihood.no_change)
    return mixture.size(unexplained) > noise + ALLOWANCE + SHARE_OF_INITIAL * before
