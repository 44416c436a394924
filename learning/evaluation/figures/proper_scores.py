"""Proper scores of probabilities, whose expectation is best for the true probabilities.

Sources: Brier, Verification of forecasts expressed in terms of probability, Monthly Weather Review
78, 1950; Gneiting and Raftery, Strictly proper scoring rules, JASA 102, 2007.
"""

from __future__ import annotations

import numpy as np

from starling.learning.evaluation.figures.judged import Judged

_SUREST = 1e-6  # A wrong probability of 0 would have an infinite log loss.


def brier(judged: Judged) -> float:
    """Mean squared difference of probability and outcome; 0 is best."""
    return float(np.mean((judged.probability - judged.ndp) ** 2))


def brier_skill(judged: Judged) -> float:
    """1 - Brier score over that of always predicting these pixels' own share; 1 is best.

    0 is no better than the share alone, which no method knows. NaN if all or none of the pixels
    have depth.
    """
    uncertainty = judged.share * (1 - judged.share)
    return 1 - brier(judged) / uncertainty if uncertainty else float("nan")


def log_loss(judged: Judged) -> float:
    """Mean negative logarithm of the probability of the outcome [nat]; 0 is best.

    Probabilities are clipped to [1e-6, 1 - 1e-6].
    """
    probability = np.clip(judged.probability, _SUREST, 1 - _SUREST)
    return float(-np.mean(np.log(np.where(judged.ndp, probability, 1 - probability))))
