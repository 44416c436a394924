"""Likelihood of a gap, given the changes that effects predict.

The residual of each feature has a Student's t distribution. Its scale combines noise, model error
of the simulator, and model error of the predicted change. Features are weighted by how little they
repeat others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.response import PredictedChange, Signature
from starling.diagnosis.which.table import Rows

# Degrees of freedom of Student's t: one feature that the simulator gets wrong must not decide.
FREEDOM = 4.0
TAU = 0.2  # Model error of a predicted change, as a share of the change.
LARGEST = 100.0  # Upper limit of a feature's squared deviation in the size of a gap.
_DETECTABLE = 1.0  # Root sum of squared deviations below which a change has no direction.


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """A gap, the standard deviation of each feature, and the feature weights."""

    gap: Rows  # (scenes, features) real less simulated; NaN where unknown.
    deviation: Rows  # (scenes, features) standard deviation: noise of both, and model error.
    weight: NDArray[np.float64]  # (features,) from `feature_weights`.

    @property
    def no_change(self) -> PredictedChange:
        """Change without effects: zeros."""
        return PredictedChange(np.zeros_like(self.gap))

    def residual(self, predicted: PredictedChange) -> Rows:
        """Compute the gap that effects leave, over its deviation (scenes, features)."""
        return (self.gap - predicted.change) / self.deviation

    def size(self, predicted: PredictedChange) -> float:
        """Compute the size of the remaining gap: the weighted mean square of `residual`.

        The deviation includes model error, so noise alone gives less than 1.

        Args:
            predicted: change by the effects.
        """
        return total_size(self.residual(predicted), self.weight)

    def scene_sizes(self, predicted: PredictedChange) -> NDArray[np.float64]:
        """Compute the size of the remaining gap in each scene (scenes,)."""
        return size_by_scene(self.residual(predicted), self.weight)

    def unexplained(self, predicted: PredictedChange) -> Rows:
        """Compute the remaining gap over a deviation that includes the effects' model error.

        This does not measure how far a gap closes: larger effects have larger model error.
        """
        return (self.gap - predicted.change) / np.sqrt(self._variance(predicted))

    def cost(self, predicted: PredictedChange) -> NDArray[np.float64]:
        """Compute the negative log-likelihood of each scene.

        For deviations beyond `LARGEST`, the distance does not include the effect's own model error.
        Otherwise an effect could gain by being less certain about a feature that it hardly changes.

        Args:
            predicted: change by the effects.

        Returns:
            (..., scenes), up to a constant.
        """
        variance, residual = self._variance(predicted), self.gap - predicted.change
        log_scale = 0.5 * np.log(variance / self.deviation**2)
        near = np.log1p(clipped_squares(residual / np.sqrt(variance)) / FREEDOM)
        far = np.log(np.maximum((residual / self.deviation) ** 2 / LARGEST, 1.0))
        log_distance = 0.5 * (FREEDOM + 1) * (near + far)
        return np.where(np.isfinite(self.gap), log_distance + log_scale, 0.0) @ self.weight

    def _variance(self, predicted: PredictedChange) -> NDArray[np.float64]:
        return self.deviation**2 + (TAU * predicted.change) ** 2 + predicted.scatter


def size_by_scene(residual: Rows, weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the size (scenes,) of a gap in each scene.

    Args:
        residual: (scenes, features) gap, or what effects leave of it, over its deviation; NaN where
            unknown.
        weight: (features,) feature weights.
    """
    return clipped_squares(residual) @ weight / np.maximum(np.isfinite(residual) @ weight, 1e-9)


def total_size(residual: Rows, weight: NDArray[np.float64]) -> float:
    """Compute the size of a gap over all scenes (arguments as `size_by_scene`)."""
    total_weight = max(float((np.isfinite(residual) @ weight).sum()), 1e-9)
    return float((clipped_squares(residual) @ weight).sum() / total_weight)


def clipped_squares(residual: Rows) -> Rows:
    """Square deviations: 0 where unknown, at most `LARGEST`."""
    return np.minimum(np.nan_to_num(residual) ** 2, LARGEST)


def change_directions(
    signatures: Sequence[Signature], deviation: Rows
) -> tuple[list[Signature], NDArray[np.float64]]:
    """Compute the direction in which each simulated value moves the features.

    Args:
        signatures: signatures of effects, at least one.
        deviation: (scenes, features) standard deviation.

    Returns:
        For each detectable change its signature, and its direction (changes, scenes, features):
        the change over its deviation, normalised to length 1.
    """
    owners = [signature for signature in signatures for _ in signature.values]
    changes = np.concatenate([signature.change for signature in signatures]) / deviation
    size = np.sqrt((changes**2).sum(axis=(1, 2)))
    detectable = np.flatnonzero(size > _DETECTABLE)
    directions = changes[detectable] / size[detectable, None, None]
    return [owners[number] for number in detectable], directions


def feature_weights(signatures: Sequence[Signature], deviation: Rows) -> NDArray[np.float64]:
    """Compute how little each feature repeats others: 1 over its sum of squared correlations.

    Features that always change together, such as the sharpness in ten regions of one image, hold
    one piece of information. Model error affects them together. Without weights they would outvote
    a single independent feature.

    Args:
        signatures: signatures of many effects; without any, all weights are 1.
        deviation: (scenes, features) standard deviation.

    Returns:
        (features,) in 0..1.
    """
    if not signatures:
        return np.ones(deviation.shape[-1])
    rows = change_directions(signatures, deviation)[1].reshape(-1, deviation.shape[-1])
    product = rows.T @ rows
    length = np.sqrt(np.diag(product))
    constant = length < 1e-6  # No effect changes these features.
    length[constant] = 1.0
    correlation = product / np.outer(length, length)
    correlation[constant, constant] = 1.0
    return 1 / (correlation**2).sum(axis=1)
