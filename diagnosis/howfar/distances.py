"""How far a simulation is from a real reading of one scene, each in its own unit; less is better.

0 is best but of a negative log likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.howfar import holes
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Ground, Image, Mask
from starling.learning.data.physics_probability import drawn_probability

_QUANTILES = np.linspace(0.005, 0.995, 199)
_LEAST_DN = 0.3  # Deviation of a code that no camera is below: rounding's.


def distances(real: Reading, simulated: Sequence[Reading], ground: Ground) -> dict[str, float]:
    """Measure a scene.

    Args:
        real: its captured reading.
        simulated: readings of several seeds.
        ground: of the scene.

    Returns:
        Brier score, 1 - AUC and ECE of what the draws tell of holes (`howfar.holes`); 1 - overlap
        of one draw's holes (`iou`); difference of bias and of the logarithm of NMAD; distance of
        the errors' distributions [px]; where there is infrared its dots' contrast and its mean
        negative log likelihood a pixel; with repeats the logarithm of noise in time.
    """
    target = real.depth_px
    draws = np.stack([one.depth_px[0] for one in simulated])
    found = _holes(~np.isfinite(target[0]), ~np.isfinite(draws), ground.counted)
    found |= _errors(target[0], draws, ground)
    if real.left is not None and simulated[0].left is not None:
        found |= _infrared(
            real.left, [one.left for one in simulated if one.left is not None], ground
        )
    return found


def _holes(real: Mask, draws: NDArray[np.bool_], where: Mask) -> dict[str, float]:
    told = drawn_probability(draws.mean(axis=0), len(draws))
    overlap = np.count_nonzero(draws[0] & real & where)
    union = np.count_nonzero((draws[0] | real) & where)
    return {
        **holes.figures(told, real, where),
        "ndp_1_iou": 1 - overlap / union if union else 0.0,
    }


def _errors(real: Image, draws: NDArray, ground: Ground) -> dict[str, float]:
    one = (real - ground.disparity_px)[ground.open]
    other = (draws[0] - ground.disparity_px)[ground.open]
    both = np.isfinite(one) & np.isfinite(other)  # Else pixels that either loses would bias it.
    one, other = (np.clip(error[both], -FAR_OFF_PX, FAR_OFF_PX) for error in (one, other))
    if one.size < 100:
        return dict.fromkeys(("bias_px", "log_nmad", "error_distribution_px"), float("nan"))
    spread = [max(float(np.median(np.abs(e - np.median(e)))), 1e-3) for e in (one, other)]
    quantiles = [np.quantile(error, _QUANTILES) for error in (one, other)]
    return {
        "bias_px": float(abs(np.median(one) - np.median(other))),
        "log_nmad": float(abs(np.log(spread[0] / spread[1]))),
        "error_distribution_px": float(np.mean(np.abs(quantiles[0] - quantiles[1]))),
    }


def _infrared(real: NDArray, simulated: Sequence[NDArray], ground: Ground) -> dict[str, float]:
    dots = ground.covariates["dots"]
    on, between = dots.where("on dots"), dots.where("between")

    def contrast(image: NDArray) -> float:
        high, low = float(image[on].mean()), float(image[between].mean())
        return (high - low) / max(high + low, 1e-6)

    frames = np.stack([one[0] for one in simulated]).astype(np.float64)
    mean = frames.mean(axis=0)
    # One photon transfer for the image: draws are too few for a deviation of each pixel.
    noise = np.polynomial.Polynomial.fit(
        mean[ground.counted], frames.var(axis=0, ddof=1)[ground.counted], 1
    )
    variance = np.maximum(noise(mean), _LEAST_DN**2)
    off = (real[0] - mean)[ground.counted]
    inside = variance[ground.counted]
    likelihood = 0.5 * np.mean(np.log(2 * np.pi * inside) + off**2 / inside)
    found = {
        "dot_contrast": abs(contrast(real[0]) - contrast(frames[0])),
        "infrared_nll": float(likelihood),
    }
    if len(real) > 1 and len(simulated[0]) > 1:
        sizes = [
            float(one.astype(np.float64).std(axis=0, ddof=1).mean()) for one in (real, simulated[0])
        ]
        found["log_noise_in_time"] = float(abs(np.log(max(sizes[0], 1e-3) / max(sizes[1], 1e-3))))
    return found
