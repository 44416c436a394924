"""Recalibration of probabilities on held-out rooms by a slope and an offset of the logit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from starling.patterns.errors import in_interval, refuse

_SUREST = 1e-6  # Probabilities are clipped to [1e-6, 1 - 1e-6] before the logit.
_STEPS = 50  # Greatest number of Newton steps.


@dataclass(frozen=True, slots=True)
class Recalibration:
    """logit(p') = slope logit(p) + offset; monotone where the slope is above 0."""

    slope: float = 1.0  # Below 1: the probabilities were overconfident.
    offset: float = 0.0  # Below 0: the probabilities were too high.

    def __post_init__(self) -> None:
        for name in ("slope", "offset"):
            in_interval(name, getattr(self, name), -1e300, 1e300, "Is the model damaged?")

    def __call__(self, probability: NDArray[np.floating]) -> NDArray[np.float64]:
        """Recalibrate probabilities of any shape."""
        return expit(self.slope * _logit(probability) + self.offset)


def _logit(probability: NDArray[np.floating]) -> NDArray[np.float64]:
    inside = np.clip(np.asarray(probability, np.float64), _SUREST, 1 - _SUREST)
    return np.log(inside) - np.log1p(-inside)


def fit_recalibration(
    probability: NDArray[np.floating], ndp: NDArray[np.bool_], weight: NDArray[np.floating]
) -> Recalibration:
    """Fit slope and offset by weighted maximum likelihood.

    Two numbers, because a few rooms determine no more. An increasing line keeps the ranking.

    Args:
        probability: (n,) of pixels in held-out rooms.
        ndp: (n,) whether they have no depth.
        weight: (n,) weights >= 0.

    Returns:
        The recalibration. If the probabilities are constant, the slope is 0 and the offset is the
        logit of the share.

    Raises:
        InputError: if the weighted pixels are all with or all without depth.

    Source: Platt, Probabilistic outputs for support vector machines, 1999, on logits.
    """
    share = float(np.average(ndp, weights=weight))
    if not 0 < share < 1:
        raise refuse(
            "no-depth pixels",
            "must be some and not all of the pixels for recalibration",
            f"a share of {share:g}",
            "Give rooms with both kinds.",
        )
    logit = _logit(probability)
    weight = np.asarray(weight / weight.sum(), np.float64)
    centre = float(np.average(logit, weights=weight))
    spread = float(np.sqrt(np.average((logit - centre) ** 2, weights=weight)))
    standardised = (logit - centre) / spread if spread > 0 else np.zeros_like(logit)
    design = np.stack([standardised, np.ones_like(standardised)])
    line = np.array([0.0, np.log(share / (1 - share))])
    loss = _loss(design, line, ndp, weight)
    for _ in range(_STEPS):  # Newton's method with step halving; the loss is convex.
        expected = expit(line @ design)
        gradient = design @ (weight * (expected - ndp))
        curvature = (design * (weight * expected * (1 - expected))) @ design.T
        step = np.linalg.solve(curvature + 1e-12 * np.eye(2), gradient)
        while (trial_loss := _loss(design, line - step, ndp, weight)) > loss + 1e-15:
            step = step / 2
        line, decrease, loss = line - step, loss - trial_loss, trial_loss
        if decrease < 1e-14:
            break
    slope = float(line[0] / spread) if spread > 0 else 0.0
    return Recalibration(slope, float(line[1]) - slope * centre)


def _loss(
    design: NDArray[np.float64],
    line: NDArray[np.float64],
    ndp: NDArray[np.bool_],
    weight: NDArray[np.float64],
) -> float:
    logit = line @ design
    return float(np.sum(weight * (np.logaddexp(0, logit) - ndp * logit)))
