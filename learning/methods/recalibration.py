"""Probabilities put right on rooms that were not learnt from: a slope and an offset in logits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from starling.patterns.errors import refuse

_SUREST = 1e-6  # Logits are taken of probabilities inside [1e-6, 1 - 1e-6].
_STEPS = 50


@dataclass(frozen=True, slots=True)
class Recalibration:
    """logit(p') = slope logit(p) + offset; monotone where the slope is above 0."""

    slope: float = 1.0  # Below 1: the probabilities were too sure of themselves.
    offset: float = 0.0  # Below 0: they were too high.

    def __call__(self, probability: NDArray[np.floating]) -> NDArray[np.float64]:
        """Put probabilities of any shape right."""
        return expit(self.slope * _logit(probability) + self.offset)


def _logit(probability: NDArray[np.floating]) -> NDArray[np.float64]:
    inside = np.clip(np.asarray(probability, np.float64), _SUREST, 1 - _SUREST)
    return np.log(inside) - np.log1p(-inside)


def fit_recalibration(
    probability: NDArray[np.floating], ndp: NDArray[np.bool_], weight: NDArray[np.floating]
) -> Recalibration:
    """Fit slope and offset by weighted maximum likelihood.

    Two numbers, not a staircase: a few rooms tell no more, and a rising line keeps the ranking.

    Args:
        probability: (n,) of pixels in rooms that the method did not learn from.
        ndp: (n,) whether they have no depth.
        weight: (n,) how much each counts, >= 0.

    Returns:
        The recalibration; with a slope of 0 and the share's logit where the probabilities tell
        nothing at all.

    Raises:
        InputError: if the pixels with weight are all of one kind.

    Source: Platt, Probabilistic outputs for support vector machines, 1999, on logits.
    """
    share = float(np.average(ndp, weights=weight))
    if not 0 < share < 1:
        raise refuse(
            "no-depth pixels",
            "must be some and not all of those recalibrated on",
            f"a share of {share:g}",
            "Give rooms with both kinds.",
        )
    logit = _logit(probability)
    weight = np.asarray(weight / weight.sum(), np.float64)
    centre = float(np.average(logit, weights=weight))
    spread = float(np.sqrt(np.average((logit - centre) ** 2, weights=weight)))
    told = (logit - centre) / spread if spread > 0 else np.zeros_like(logit)
    design = np.stack([told, np.ones_like(told)])
    found = np.array([0.0, np.log(share / (1 - share))])
    loss = _loss(design, found, ndp, weight)
    for _ in range(_STEPS):  # Newton with halved steps: the likelihood is convex.
        expected = expit(found @ design)
        gradient = design @ (weight * (expected - ndp))
        curvature = (design * (weight * expected * (1 - expected))) @ design.T
        step = np.linalg.solve(curvature + 1e-12 * np.eye(2), gradient)
        while (tried := _loss(design, found - step, ndp, weight)) > loss + 1e-15:
            step = step / 2
        found, gained, loss = found - step, loss - tried, tried
        if gained < 1e-14:
            break
    slope = float(found[0] / spread) if spread > 0 else 0.0
    return Recalibration(slope, float(found[1]) - slope * centre)


def _loss(
    design: NDArray[np.float64],
    found: NDArray[np.float64],
    ndp: NDArray[np.bool_],
    weight: NDArray[np.float64],
) -> float:
    logit = found @ design
    return float(np.sum(weight * (np.logaddexp(0, logit) - ndp * logit)))
