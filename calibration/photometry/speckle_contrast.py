"""Speckle's contrast, from what a fit of levels leaves over.

Speckle multiplies laser light alone, so the residuals' variance grows with the square of the
laser's part of the level, noise's with the level itself.

Source: Goodman, Speckle Phenomena in Optics (2007), ch. 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.calibration.least_squares import tiles
from starling.calibration.photometry.blocks import blocks, quietest, quietest_by_chance
from starling.calibration.photometry.levels import part
from starling.calibration.photometry.photometry_open import EVEN
from starling.calibration.photometry.prediction import Prediction
from starling.calibration.solution import Estimate
from starling.sim.imaging import speckle_field
from starling.sim.imaging.imager import mixed, noise_e
from starling.sim.sensor.sensor import Sensor

SPECKLE = "projector.speckle_contrast"

_LAGS = 3  # Pixels to which speckle's own correlation is followed.
_BRIGHTEST = 0.3  # Share of the blocks with most laser light, where speckle shows.


def fit_speckle(
    predictions: Sequence[Prediction], sensor: Sensor, *, frames: int = 1
) -> Estimate | None:
    """Fit the contrast; whatever else the prediction misses is taken for speckle.

    Args:
        predictions: of `fit_photometry`; those with the projector on count.
        sensor: as fitted; its smoothing, crosstalk and grain say what of speckle is left.
        frames: that each captured image is the mean of.

    Returns:
        The estimate, an upper bound where geometry or pattern are not quite right. Where the images
        do not halve the deviation of what may lie anywhere from 0 to 1, or less is left at the
        quietest places than the contrast needs, the sensor's own value, or what those places allow,
        with an infinite deviation. None where no image has laser light whose dots are where they
        were predicted.
    """
    rows, outs, groups = [], [], []
    for number, prediction in enumerate(
        p for p in predictions if p.on and p.dots and p.sharp_laser_dn.any()
    ):
        shape = (prediction.level_dn.shape[0], prediction.level_dn.shape[1])
        squared = _kept(prediction, sensor)
        residual = _without_trend(prediction)
        images = (np.ones(shape), np.maximum(prediction.signal_dn, 0), squared, residual**2)
        used = tiles.tiled(prediction.used.astype(np.float64))
        whole = used.mean(axis=1) > 0.5
        table = np.stack([(tiles.tiled(i) * used)[whole] for i in images], axis=1)
        rows.append(table)
        groups.append(tiles.clusters(shape)[whole] + 10**6 * number)
        outs.append(used[whole])
    if not rows:
        return None
    table, used, cluster = (np.concatenate(part) for part in (rows, outs, groups))
    value, sd = _line(table, used, cluster)
    contrast = float(np.sqrt(max(value, 0.0)))
    deviation = float(sd / (2 * contrast)) if value > sd else float(np.sqrt(sd))
    start, most = sensor.projector.speckle_contrast, speckle_bound(predictions, sensor)
    told = deviation <= EVEN / 2 and contrast <= most
    return Estimate(
        name=SPECKLE,
        value=contrast if told else min(start, most),
        sd=deviation if told else np.inf,
        unit="1",
        start=start,
    )


def speckle_bound(predictions: Sequence[Prediction], sensor: Sensor) -> float:
    """Contrast that speckle has at most, by the places where residuals are smallest.

    Texture, and dots that are not quite as predicted, leave residuals that grow with the laser's
    light as speckle's do, but not everywhere; speckle is everywhere.

    Args:
        predictions: of `fit_photometry`, projector on.
        sensor: as fitted: what noise is to be expected beside.

    Returns:
        The contrast at which the quietest tenth of blocks of 8 px is as quiet as chance makes it;
        1 where there is no block.
    """
    seen, noise, laser, pixels = [], [], [], []
    for prediction in (p for p in predictions if p.on and p.dots):
        residual = np.where(prediction.used, _without_trend(prediction), np.nan)
        imager = part(sensor, prediction.side)
        gain = imager.dn_per_electron
        electrons = prediction.signal_dn / np.float32(gain)
        noise_dn = gain * noise_e(imager, electrons, imager.exposure_s)
        images = (residual, noise_dn**2 + 1 / 12)
        variance, expected = (blocks(image) for image in images)
        squared = blocks(_kept(prediction, sensor))
        whole = np.isfinite(variance).all(axis=1)
        seen.append(variance[whole].var(axis=1, ddof=1))
        noise.append(expected[whole].mean(axis=1))
        laser.append(squared[whole].mean(axis=1))
        square = np.maximum((squared[whole] ** 2).sum(axis=1), 1e-12)
        pixels.append(squared[whole].sum(axis=1) ** 2 / square)
    if not sum(map(len, seen)):
        return 1.0
    found, quiet, light = (np.concatenate(one) for one in (seen, noise, laser))
    bright = light >= np.quantile(light, 1 - _BRIGHTEST)
    found, quiet, light = found[bright], quiet[bright], light[bright]
    chance = quietest_by_chance(float(np.median(np.concatenate(pixels)[bright])))

    def surplus(contrast: float) -> float:
        return quietest(found / (quiet + contrast**2 * light)) - chance

    if surplus(0.0) <= 0:
        return 0.0
    if surplus(1.0) >= 0:
        return 1.0
    return float(optimize.root_scalar(surplus, bracket=(0.0, 1.0)).root)


def _line(table: NDArray, used: NDArray, cluster: NDArray) -> tuple[float, float]:
    """Coefficient of the squared laser light in the squared residuals, and its deviation.

    Weighted twice by the variance the last round predicts; deviations hold for clusters.
    """
    columns, target = table[:, :3], table[:, 3]
    scale = np.maximum(columns.mean(axis=(0, 2)), 1e-12)
    weight = used
    solution = np.zeros(3)
    for _ in range(4):
        matrix = np.einsum("nkp,nlp,np->kl", columns, columns, weight) / np.outer(scale, scale)
        right = np.einsum("nkp,np,np->k", columns, target, weight) / scale
        solution = np.linalg.pinv(matrix, rcond=1e-10) @ right / scale
        expected = np.einsum("k,nkp->np", np.maximum(solution, 0), columns)
        weight = used / np.maximum(expected, 1e-3 * expected.mean() + 1e-12) ** 2
    matrix = np.einsum("nkp,nlp,np->kl", columns, columns, weight) / np.outer(scale, scale)
    left = target - np.einsum("k,nkp->np", solution, columns)
    each = np.einsum("nkp,np,np->nk", columns, left, weight) / scale
    _, place = np.unique(cluster, return_inverse=True)
    scores = np.zeros((int(place.max()) + 1, 3))
    np.add.at(scores, place, each)
    bread = np.linalg.pinv(matrix, rcond=1e-10)
    meat = scores.T @ scores * len(scores) / max(len(scores) - 3, 1)
    covariance = bread @ meat @ bread / np.outer(scale, scale)
    return float(solution[2]), float(np.sqrt(covariance[2, 2]))


def _without_trend(prediction: Prediction) -> NDArray[np.float64]:
    """Residual less what is smooth over a tile: errors of shading are no speckle."""
    used = prediction.used.astype(np.float32)
    residual = np.where(prediction.used, prediction.residual_dn, 0).astype(np.float32)
    sigma = tiles.TILE_PX / 2
    weight = np.maximum(cv2.GaussianBlur(used, (0, 0), sigma), 1e-6)
    mean = cv2.GaussianBlur(residual, (0, 0), sigma) / weight
    return (residual - mean).astype(np.float64)


def _kept(prediction: Prediction, sensor: Sensor) -> NDArray[np.float64]:
    """Variance that speckle of contrast 1 has after crosstalk and averaging (h, w) [DN^2].

    Both weigh neighbours' laser light L, as it was before them, by a kernel k: of independent
    grains the sum of k^2 L^2 is left, more where neighbours share grains.
    """
    imager = part(sensor, prediction.side)
    size = 2 * int(np.ceil(4 * imager.smoothing_px + 2)) + 1
    point = np.zeros((size, size), np.float32)
    point[size // 2, size // 2] = 1
    kernel = mixed(imager, point).astype(np.float64)
    grain_px = speckle_field.grain_px(
        wavelength_nm=sensor.projector.wavelength_nm,
        f_number=imager.lens.f_number,
        pixel_pitch_m=imager.pixel_pitch_m,
    )
    shared = _shared(grain_px)
    padded = np.pad(kernel, _LAGS)
    total = sum(
        shared[abs(dy)] * shared[abs(dx)] * (padded * np.roll(padded, (dy, dx), (0, 1))).sum()
        for dy in range(-_LAGS, _LAGS + 1)
        for dx in range(-_LAGS, _LAGS + 1)
    )
    more = total / (kernel**2).sum()
    laser = prediction.sharp_laser_dn.astype(np.float64) ** 2
    return more * cv2.filter2D(laser, cv2.CV_64F, kernel**2, borderType=cv2.BORDER_REFLECT)


def _shared(grain_px: float) -> NDArray[np.float64]:
    """Correlation of speckle in pixels 0, 1, 2, 3 apart along one axis.

    Averaging the grain's Gaussian correlation over two pixels weighs it by a triangle.
    """
    sigma = grain_px / (2 * np.sqrt(2 * np.log(2)))
    offset = (np.arange(-200, 201) / 200)[None, :]
    lag = np.arange(_LAGS + 1)[:, None]
    triangle = 1 - np.abs(offset)
    covariance = (triangle * np.exp(-((lag + offset) ** 2) / (2 * sigma**2))).sum(axis=1)
    return covariance / covariance[0]
