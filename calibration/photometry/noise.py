"""Fit what makes noise: photon transfer of both imagers' repeats, and speckle's contrast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.observation import Observation
from starling.calibration.photometry.blocks import BLOCK_PX, blocks, quietest, quietest_by_chance
from starling.calibration.photometry.photometry_open import EVEN
from starling.calibration.photometry.photon_transfer import fit_photon_transfer
from starling.calibration.photometry.prediction import Prediction
from starling.calibration.photometry.speckle_contrast import SPECKLE, fit_speckle, speckle_bound
from starling.calibration.solution import Estimate, Solution
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor.sensor import Sensor

_PHOTON = ("left.full_well_e", "left.read_noise_e", "left.smoothing_px")
_UNITS = ("electrons", "electrons", "px")
_WIDEST_PX = 3.0  # Averaging, as far as neighbours tell.
_NEAR = 0.3  # Share of the blocks whose level counts as the median.


def fit_noise(
    observations: Sequence[Observation], predictions: Sequence[Prediction], sensor: Sensor
) -> Solution:
    """Fit electrons per DN, read noise, averaging and speckle.

    Both imagers are taken as one part. Photon transfer needs repeats; those of the scene with
    most frames are taken.

    Args:
        observations: captured.
        predictions: of `fit_photometry` on them; without, speckle is left open.
        sensor: with the levels fitted.
    """
    with_repeats = [one.repeats for one in observations if one.repeats is not None]
    open_: list[str] = []
    if with_repeats:
        transfer = fit_photon_transfer(max(with_repeats, key=len), sensor)
        estimates, covariance = list(transfer.estimates), transfer.covariance
        open_ += transfer.undetermined
    else:
        starts = (sensor.left.full_well_e, sensor.left.read_noise_e, sensor.left.smoothing_px)
        estimates = [
            Estimate(name=name, value=start, sd=np.inf, unit=unit, start=start)
            for name, unit, start in zip(_PHOTON, _UNITS, starts, strict=True)
        ]
        covariance = np.diag(np.full(len(estimates), np.inf))
        bound = [noise_bound_dn(one) for one in predictions if one.side == "left"]
        most = f" (at most {min(bound):.2g} DN, from the quietest places)" if bound else ""
        open_.append(
            f"{', '.join(_PHOTON)} are open: noise cannot be told from texture in single "
            f"images{most}; capture a scene at rest twice or more."
        )
    estimates, covariance, lost = _believed(estimates, covariance)
    open_ += lost
    fitted = _both(sensor, estimates)
    grain = fit_speckle(predictions, fitted)
    if grain is None:
        open_.append(
            f"{SPECKLE} is open: no image has the projector's dots where they are predicted; "
            "calibrate geometry and pattern first."
        )
    else:
        if np.isinf(grain.sd):
            most = speckle_bound(predictions, fitted)
            open_.append(
                f"{SPECKLE} is open: texture and dots not quite as predicted leave more over than "
                f"speckle can (at most {most:.2g}, from the quietest places); capture an even wall "
                "that fills the image, with less ambient light."
            )
        estimates.append(grain)
        covariance = np.pad(covariance, (0, 1))
        covariance[-1, -1] = grain.sd**2
        fitted = _both(fitted, [grain])
    return Solution(
        estimates=tuple(estimates),
        covariance=covariance,
        undetermined=tuple(open_),
        cost=(),
        sensor=fitted,
    )


def _believed(
    estimates: Sequence[Estimate], covariance: NDArray[np.float64]
) -> tuple[list[Estimate], NDArray[np.float64], list[str]]:
    """Leave open what is known less than by its range: a full well to its own size, averaging."""
    spans = {"left.full_well_e": None, "left.smoothing_px": EVEN * _WIDEST_PX}
    out, covariance, open_ = list(estimates), covariance.copy(), []
    for i, one in enumerate(estimates):
        span = spans.get(one.name, np.inf)
        if not np.isfinite(one.sd) or one.sd <= (one.value if span is None else span):
            continue
        out[i] = replace(one, value=one.start, sd=np.inf)
        covariance[i, :] = covariance[:, i] = 0.0
        covariance[i, i] = np.inf
        open_.append(
            f"{one.name} is open: its deviation of {one.sd:.2g} {one.unit} is more than its range "
            "leaves; capture a scene of many levels at rest, more often."
        )
    return out, covariance, open_


def noise_bound_dn(prediction: Prediction) -> float:
    """Deviation [DN] that noise has at most about the image's median level.

    Residuals hold beside noise what the model misses; blocks of 8 px where they vary least hold
    least of that. By chance alone the quietest tenth of blocks of pure noise varies less than
    noise does, which is allowed for as if averaging left a quarter of the pixels independent.

    Args:
        prediction: with its residuals.

    Returns:
        The bound; NaN where no block is whole.
    """
    residual = blocks(np.where(prediction.used, prediction.residual_dn, np.nan))
    level = blocks(prediction.signal_dn).mean(axis=1)
    whole = np.isfinite(residual).all(axis=1)
    if not whole.any():
        return float("nan")
    residual, level = residual[whole], level[whole]
    off = np.abs(level - np.median(level))
    variance = residual[off <= np.quantile(off, _NEAR)].var(axis=1, ddof=1)
    return float(np.sqrt(quietest(variance) / quietest_by_chance(BLOCK_PX**2)))


def _both(sensor: Sensor, estimates: Sequence[Estimate]) -> Sensor:
    """Set what was fitted, in both imagers."""
    edits = [(e.name.replace("left.", "imager."), e.value) for e in estimates]
    return sensor_edits.with_values(sensor, edits)
