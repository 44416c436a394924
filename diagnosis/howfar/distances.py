"""Distances between simulated and real observations of one scene, each in its own unit.

Less is better; the optimum is 0 except for the negative log-likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Image, Mask, Strata
from starling.learning.data.physics import drawn_probability
from starling.learning.evaluation.metrics import brier, judge, reliability, roc

_QUANTILES = np.linspace(0.005, 0.995, 199)
_LEAST_DN = 0.3  # Least noise std [DN]: rounding alone causes 1 / sqrt(12).


def scene_distances(
    real: SceneObservation, simulated: Sequence[SceneObservation], strata: Strata
) -> dict[str, float]:
    """Measure the distances of one scene.

    Args:
        real: captured observation.
        simulated: simulated observations of several seeds.
        strata: pixel strata of the scene.

    Returns:
        Distance by name. Holes: Brier score, 1 - AUC and ECE of the probability from all draws
        (`hole_figures`), and 1 - IoU of one draw. Disparity: difference of bias [px], log ratio of
        NMAD, and distance of the error distributions [px]. With infrared: difference of dot
        contrast, and negative log-likelihood per pixel. With repeats: log ratio of temporal noise.
    """
    target = real.depth_px
    draws = np.stack([observation.depth_px[0] for observation in simulated])
    figures = _holes(~np.isfinite(target[0]), ~np.isfinite(draws), strata.counted)
    figures |= _errors(target[0], draws, strata)
    pairs = [pair for pair in simulated if isinstance(pair, StereoObservation)]
    if isinstance(real, StereoObservation) and pairs:
        figures |= _infrared(real.left, [pair.left for pair in pairs], strata)
    return figures


def _holes(real: Mask, draws: NDArray[np.bool_], where: Mask) -> dict[str, float]:
    probability = drawn_probability(draws.mean(axis=0), len(draws))
    overlap = np.count_nonzero(draws[0] & real & where)
    union = np.count_nonzero((draws[0] | real) & where)
    return {
        **hole_figures(probability, real, where),
        "ndp_1_iou": 1 - overlap / union if union else 0.0,
    }


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


def _errors(real: Image, draws: NDArray, strata: Strata) -> dict[str, float]:
    real_error = (real - strata.disparity_px)[strata.interior]
    simulated_error = (draws[0] - strata.disparity_px)[strata.interior]
    both = np.isfinite(real_error) & np.isfinite(
        simulated_error
    )  # Pixels lost by either would bias the comparison.
    real_error, simulated_error = (
        np.clip(error[both], -FAR_OFF_PX, FAR_OFF_PX) for error in (real_error, simulated_error)
    )
    if real_error.size < 100:
        return dict.fromkeys(("bias_px", "log_nmad", "error_distribution_px"), float("nan"))
    spread = [
        max(float(np.median(np.abs(e - np.median(e)))), 1e-3) for e in (real_error, simulated_error)
    ]
    quantiles = [np.quantile(error, _QUANTILES) for error in (real_error, simulated_error)]
    return {
        "bias_px": float(abs(np.median(real_error) - np.median(simulated_error))),
        "log_nmad": float(abs(np.log(spread[0] / spread[1]))),
        "error_distribution_px": float(np.mean(np.abs(quantiles[0] - quantiles[1]))),
    }


def _infrared(real: NDArray, simulated: Sequence[NDArray], strata: Strata) -> dict[str, float]:
    dots = strata.covariates["dots"]
    on, between = dots.mask("on dots"), dots.mask("between")

    def contrast(image: NDArray) -> float:
        high, low = float(image[on].mean()), float(image[between].mean())
        return (high - low) / max(high + low, 1e-6)

    frames = np.stack([images[0] for images in simulated]).astype(np.float64)
    mean = frames.mean(axis=0)
    # Fit one photon transfer curve: the draws are too few for a variance of each pixel.
    photon_transfer = np.polynomial.Polynomial.fit(
        mean[strata.counted], frames.var(axis=0, ddof=1)[strata.counted], 1
    )
    variance = np.maximum(photon_transfer(mean), _LEAST_DN**2)
    residual = (real[0] - mean)[strata.counted]
    inside = variance[strata.counted]
    likelihood = 0.5 * np.mean(np.log(2 * np.pi * inside) + residual**2 / inside)
    figures = {
        "dot_contrast": abs(contrast(real[0]) - contrast(frames[0])),
        "infrared_nll": float(likelihood),
    }
    if len(real) > 1 and len(simulated[0]) > 1:
        sizes = [
            float(images.astype(np.float64).std(axis=0, ddof=1).mean())
            for images in (real, simulated[0])
        ]
        figures["log_noise_in_time"] = float(abs(np.log(max(sizes[0], 1e-3) / max(sizes[1], 1e-3))))
    return figures
