"""Proper scores of probabilities: best, in expectation, when the probabilities are the true ones.

Sources: Brier, Verification of forecasts expressed in terms of probability, Monthly Weather Review
78, 1950; Gneiting and Raftery, Strictly proper scoring rules, JASA 102, 2007.
"""

from __future__ import annotations

import numpy as np

from starling.learning.evaluation.figures.judged import Judged

_SUREST = 1e-6  # A probability of 0 that proves wrong would cost infinitely much.


def brier(judged: Judged) -> float:
    """Mean squared difference of probability and outcome; 0 is best."""
    return float(np.mean((judged.probability - judged.ndp) ** 2))


def brier_skill(judged: Judged) -> float:
    """1 - Brier score over that of always telling these pixels' own share; 1 is best.

    0 is no better than knowing the share alone, which no method is told. NaN where the pixels are
    all of one kind.
    """
    uncertainty = judged.share * (1 - judged.share)
    return 1 - brier(judged) / uncertainty if uncertainty else float("nan")


def log_loss(judged: Judged) -> float:
    """Mean negative logarithm of the probability of what happened [nat]; 0 is best.

    Probabilities count as at least 1e-6 and at most 1 - 1e-6.
    """
    probability = np.clip(judged.probability, _SUREST, 1 - _SUREST)
    return float(-np.mean(np.log(np.where(judged.ndp, probability, 1 - probability))))
