"""Fit noise parameters: photon transfer of repeated images, and speckle contrast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.observation import Observation
from starling.calibration.photometry.photometry_open import EVEN
from starling.calibration.photometry.photon_transfer import fit_photon_transfer
from starling.calibration.photometry.prediction import Prediction
from starling.calibration.photometry.speckle_contrast import (
    BLOCK_PX,
    SPECKLE,
    blocks,
    fit_speckle,
    quietest,
    quietest_by_chance,
    speckle_bound,
)
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

_PHOTON = ("left.full_well_e", "left.read_noise_e", "left.smoothing_px")
_UNITS = ("electrons", "electrons", "px")
_WIDEST_PX = 3.0  # Maximum sigma of averaging.
_NEAR = 0.3  # Share of blocks, nearest to the median level, in the noise bound.


def fit_noise(
    observations: Sequence[Observation], predictions: Sequence[Prediction], sensor: Sensor
) -> Solution:
    """Fit electrons per DN, read noise, averaging and speckle.

    Both imagers share the parameters. Photon transfer uses the repeats of the scene with the most
    frames.

    Args:
        observations: captured scenes.
        predictions: predictions of `fit_photometry`; without them, speckle is unidentifiable.
        sensor: sensor with fitted levels.
    """
    by_scene = {item.name: item.repeats for item in observations if item.repeats is not None}
    open_sentences: list[str] = []
    if by_scene:
        name, repeats = max(by_scene.items(), key=lambda item: len(item[1]))
        with errors.naming(f"scene {name}"):
            transfer = fit_photon_transfer(repeats, sensor)
        estimates, covariance = list(transfer.estimates), transfer.covariance
        open_sentences += transfer.undetermined
    else:
        starts = (sensor.left.full_well_e, sensor.left.read_noise_e, sensor.left.smoothing_px)
        estimates = [
            Estimate(name=name, value=start, sd=np.inf, unit=unit, start=start)
            for name, unit, start in zip(_PHOTON, _UNITS, starts, strict=True)
        ]
        covariance = np.diag(np.full(len(estimates), np.inf))
        bound = [noise_bound_dn(item) for item in predictions if item.side == "left"]
        bound_text = (
            f" (at most {min(bound):.2g} DN, from the blocks with the least variance)"
            if bound
            else ""
        )
        open_sentences.append(
            f"{', '.join(_PHOTON)} are not determined: noise and texture cannot be separated in "
            f"single images{bound_text}; capture a static scene at least twice."
        )
    estimates, covariance, unidentifiable = _accept(estimates, covariance)
    open_sentences += unidentifiable
    fitted = _with_estimates(sensor, estimates)
    grain = fit_speckle(predictions, fitted)
    if grain is None:
        open_sentences.append(
            f"{SPECKLE} is not determined: the projector's dots match the prediction in no image; "
            "calibrate geometry and pattern first."
        )
    else:
        if np.isinf(grain.sd):
            upper = speckle_bound(predictions, fitted)
            open_sentences.append(
                f"{SPECKLE} is not determined: texture and errors of dots leave larger residuals "
                f"than speckle (at most {upper:.2g}, from the blocks with the least variance); "
                "capture a uniform wall that fills the image, with less ambient light."
            )
        estimates.append(grain)
        covariance = np.pad(covariance, (0, 1))
        covariance[-1, -1] = grain.sd**2
        fitted = _with_estimates(fitted, [grain])
    return Solution(
        estimates=tuple(estimates),
        covariance=covariance,
        undetermined=tuple(open_sentences),
        cost=(),
        sensor=fitted,
    )


def _accept(
    estimates: Sequence[Estimate], covariance: NDArray[np.float64]
) -> tuple[list[Estimate], NDArray[np.float64], list[str]]:
    """Reject estimates whose standard deviation exceeds that of their range, or their value."""
    spans = {"left.full_well_e": None, "left.smoothing_px": EVEN * _WIDEST_PX}
    accepted, covariance, open_sentences = list(estimates), covariance.copy(), []
    for i, estimate in enumerate(estimates):
        span = spans.get(estimate.name, np.inf)
        if not np.isfinite(estimate.sd) or estimate.sd <= (
            estimate.value if span is None else span
        ):
            continue
        accepted[i] = replace(estimate, value=estimate.start, sd=np.inf)
        covariance[i, :] = covariance[:, i] = 0.0
        covariance[i, i] = np.inf
        open_sentences.append(
            f"{estimate.name} is not determined: its standard deviation of {estimate.sd:.2g} "
            f"{estimate.unit} exceeds that of its range; capture more frames of a static scene "
            "with many levels."
        )
    return accepted, covariance, open_sentences


def noise_bound_dn(prediction: Prediction) -> float:
    """Return an upper bound of the noise's standard deviation [DN] near the median level.

    Residuals contain noise and model errors. Blocks of 8 px with the least variance have the
    smallest model errors. The bound corrects for the variance that the quietest tenth of blocks
    has by chance, with a quarter of the pixels independent.

    Args:
        prediction: prediction with its residuals.

    Returns:
        The bound; NaN if no block is complete.
    """
    residual = blocks(np.where(prediction.used, prediction.residual_dn, np.nan))
    level = blocks(prediction.signal_dn).mean(axis=1)
    complete = np.isfinite(residual).all(axis=1)
    if not complete.any():
        return float("nan")
    residual, level = residual[complete], level[complete]
    distance = np.abs(level - np.median(level))
    variance = residual[distance <= np.quantile(distance, _NEAR)].var(axis=1, ddof=1)
    return float(np.sqrt(quietest(variance) / quietest_by_chance(BLOCK_PX**2)))


def _with_estimates(sensor: Sensor, estimates: Sequence[Estimate]) -> Sensor:
    """Set the estimates in both imagers."""
    edits = [(estimate.name.replace("left.", "imager."), estimate.value) for estimate in estimates]
    return with_values(sensor, edits)
