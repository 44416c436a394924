"""How well holes are told: the figures of `starling evaluate`, of one scene."""

from __future__ import annotations

from starling.diagnosis.scenes.strata import Image, Mask
from starling.learning.evaluation.figures.judged import judge
from starling.learning.evaluation.figures.proper_scores import brier
from starling.learning.evaluation.figures.reliability import reliability
from starling.learning.evaluation.figures.roc import roc


def figures(told: Image, real: Mask, counted: Mask) -> dict[str, float]:
    """Measure what is told of a scene's holes; the less, the better.

    Args:
        told: (h, w) probability, 0 to 1, that a pixel has no depth.
        real: (h, w) pixels that have none.
        counted: (h, w) pixels that count.

    Returns:
        Brier score, 1 - AUC (NaN where the pixels are all of one kind) and ECE.

    Raises:
        InputError: if no pixel counts, or a probability is none.
    """
    judged = judge(told, real, counted)
    area = roc(judged).area if 0 < judged.share < 1 else float("nan")
    return {
        "ndp_brier": brier(judged),
        "ndp_1_auc": 1 - area,
        "ndp_ece": reliability(judged).expected_calibration_error,
    }
