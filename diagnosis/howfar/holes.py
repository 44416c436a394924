"""Accuracy of predicted holes in one scene, with the figures of `starling evaluate`."""

from __future__ import annotations

from starling.diagnosis.scenes.strata import Image, Mask
from starling.learning.evaluation.metrics import brier, judge, reliability, roc


def hole_figures(probability: Image, real: Mask, counted: Mask) -> dict[str, float]:
    """Measure the accuracy of a hole probability; less is better.

    Args:
        probability: (h, w) probability, 0 to 1, that a pixel has no depth.
        real: (h, w) pixels without depth.
        counted: (h, w) pixels to include.

    Returns:
        Brier score, 1 - AUC (NaN if all pixels are of one class) and ECE.

    Raises:
        InputError: if no pixel is counted, or a value is not a probability.
    """
    judged = judge(probability, real, counted)
    area = roc(judged).area if 0 < judged.share < 1 else float("nan")
    return {
        "ndp_brier": brier(judged),
        "ndp_1_auc": 1 - area,
        "ndp_ece": reliability(judged).expected_calibration_error,
    }
