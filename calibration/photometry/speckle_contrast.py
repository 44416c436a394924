"""Estimate the speckle contrast from the residuals of a fit of levels.

Speckle multiplies only laser light, so its variance is proportional to the square of the laser
level. The variance of shot noise is proportional to the level.

Source: Goodman, Speckle Phenomena in Optics (2007), ch. 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from starling.calibration.least_squares import tiles, variable_projection
from starling.calibration.photometry.levels import side_imager
from starling.calibration.photometry.photometry_open import EVEN
from starling.calibration.photometry.prediction import Prediction
from starling.calibration.solution import Estimate
from starling.sim.imaging.imager import mix_pixels, noise_e
from starling.sim.imaging.optics import speckle
from starling.sim.sensor.sensor import Sensor

SPECKLE = "projector.speckle_contrast"
BLOCK_PX = 8  # Side of a block; the blocks with the least variance show mainly noise.

_QUIETEST = 0.1  # Quantile of the blocks' variance.
_INDEPENDENT = 0.25  # Share of independent pixels in a block, after the device's averaging.
_LAGS = 3  # Maximum lag of the speckle correlation [px].
_BRIGHTEST = 0.3  # Share of blocks with the most laser light, where speckle dominates.


def fit_speckle(predictions: Sequence[Prediction], sensor: Sensor) -> Estimate | None:
    """Fit the contrast; other errors of the prediction add to it.

    Args:
        predictions: predictions of `fit_photometry`; only those with the projector on are used.
        sensor: fitted sensor; its smoothing, crosstalk and grain size attenuate speckle.

    Returns:
        The estimate, which is an upper bound if geometry or pattern have errors. It is
        unidentifiable if its deviation exceeds half that of a uniform prior from 0 to 1, or if the
        contrast exceeds `speckle_bound`. Then it is the sensor's value, at most the bound, with an
        infinite deviation. None if no image has laser light with matching dots.
    """
    rows, used_masks, groups = [], [], []
    for number, prediction in enumerate(
        candidate
        for candidate in predictions
        if candidate.on and candidate.dots and candidate.sharp_laser_dn.any()
    ):
        shape = prediction.level_dn.shape
        squared = _speckle_variance(prediction, sensor)
        residual = _without_trend(prediction)
        images = (np.ones(shape), np.maximum(prediction.signal_dn, 0), squared, residual**2)
        used = tiles.cut_tiles(prediction.used.astype(np.float64))
        enough = used.mean(axis=1) > 0.5
        table = np.stack([(tiles.cut_tiles(image) * used)[enough] for image in images], axis=1)
        rows.append(table)
        groups.append(tiles.clusters(shape)[enough] + 10**6 * number)
        used_masks.append(used[enough])
    if not rows:
        return None
    table, used, cluster = (np.concatenate(values) for values in (rows, used_masks, groups))
    value, sd = _line(table, used, cluster)
    contrast = float(np.sqrt(max(value, 0.0)))
    deviation = float(sd / (2 * contrast)) if value > sd else float(np.sqrt(sd))
    start, bound = sensor.projector.speckle_contrast, speckle_bound(predictions, sensor)
    determined = deviation <= EVEN / 2 and contrast <= bound
    return Estimate(
        name=SPECKLE,
        value=contrast if determined else min(start, bound),
        sd=deviation if determined else np.inf,
        unit="1",
        start=start,
    )


def speckle_bound(predictions: Sequence[Prediction], sensor: Sensor) -> float:
    """Return an upper bound of the contrast from the blocks with the smallest residuals.

    Texture and errors of dots also cause residuals that grow with laser light, but only in some
    places. Speckle is present everywhere.

    Args:
        predictions: predictions of `fit_photometry`, projector on.
        sensor: fitted sensor, for the expected noise.

    Returns:
        The contrast at which the quietest tenth of blocks of 8 px has the variance expected by
        chance; 1 without blocks.
    """
    variances, noise, laser, pixels = [], [], [], []
    for prediction in (candidate for candidate in predictions if candidate.on and candidate.dots):
        residual = np.where(prediction.used, _without_trend(prediction), np.nan)
        imager = side_imager(sensor, prediction.side)
        gain = imager.dn_per_electron
        electrons = prediction.signal_dn / np.float32(gain)
        noise_dn = gain * noise_e(imager, electrons, imager.exposure_s)
        images = (residual, noise_dn**2 + 1 / 12)
        variance, expected = (blocks(image) for image in images)
        squared = blocks(_speckle_variance(prediction, sensor))
        complete = np.isfinite(variance).all(axis=1)
        variances.append(variance[complete].var(axis=1, ddof=1))
        noise.append(expected[complete].mean(axis=1))
        laser.append(squared[complete].mean(axis=1))
        square = np.maximum((squared[complete] ** 2).sum(axis=1), 1e-12)
        pixels.append(squared[complete].sum(axis=1) ** 2 / square)
    if not sum(map(len, variances)):
        return 1.0
    measured, noise_variance, light = (
        np.concatenate(values) for values in (variances, noise, laser)
    )
    bright = light >= np.quantile(light, 1 - _BRIGHTEST)
    measured, noise_variance, light = measured[bright], noise_variance[bright], light[bright]
    chance = quietest_by_chance(float(np.median(np.concatenate(pixels)[bright])))

    def surplus(contrast: float) -> float:
        return quietest(measured / (noise_variance + contrast**2 * light)) - chance

    if surplus(0.0) <= 0:
        return 0.0
    if surplus(1.0) >= 0:
        return 1.0
    return float(optimize.root_scalar(surplus, bracket=(0.0, 1.0)).root)


def blocks(image: NDArray) -> NDArray:
    """Return the pixels of each block (n, 64); incomplete blocks are dropped."""
    return variable_projection.cut(image, BLOCK_PX)


def quietest_by_chance(pixels: float) -> float:
    """Return the 10 % quantile of the variance of blocks of pure noise, over its mean.

    Args:
        pixels: number of noisy pixels in a block, including correlated neighbours.
    """
    freedom = max(_INDEPENDENT * pixels - 1, 1.0)
    return float(stats.chi2.ppf(_QUIETEST, freedom)) / freedom


def quietest(variance: NDArray) -> float:
    """Return the 10 % quantile of the blocks' variance (n,)."""
    return float(np.quantile(variance, _QUIETEST))


def _line(table: NDArray, used: NDArray, cluster: NDArray) -> tuple[float, float]:
    """Regress squared residuals on squared laser light; return the coefficient and its deviation.

    The weights are iterated from the predicted variance. The deviation is clustered.
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
    residual = target - np.einsum("k,nkp->np", solution, columns)
    tile_scores = np.einsum("nkp,np,np->nk", columns, residual, weight) / scale
    _, index = np.unique(cluster, return_inverse=True)
    scores = np.zeros((int(index.max()) + 1, 3))
    np.add.at(scores, index, tile_scores)
    bread = np.linalg.pinv(matrix, rcond=1e-10)
    meat = scores.T @ scores * len(scores) / max(len(scores) - 3, 1)
    covariance = bread @ meat @ bread / np.outer(scale, scale)
    return float(solution[2]), float(np.sqrt(covariance[2, 2]))


def _without_trend(prediction: Prediction) -> NDArray[np.float64]:
    """Subtract the residual's smooth trend, because shading errors are not speckle."""
    used = prediction.used.astype(np.float32)
    residual = np.where(prediction.used, prediction.residual_dn, 0).astype(np.float32)
    sigma = tiles.TILE_PX / 2
    weight = np.maximum(cv2.GaussianBlur(used, (0, 0), sigma), 1e-6)
    mean = cv2.GaussianBlur(residual, (0, 0), sigma) / weight
    return (residual - mean).astype(np.float64)


def _speckle_variance(prediction: Prediction, sensor: Sensor) -> NDArray[np.float64]:
    """Return the variance of speckle of contrast 1 after crosstalk and averaging (h, w) [DN^2].

    Both weight the laser light L of neighbours by a kernel k. Independent grains have the variance
    sum of k^2 L^2. Grains that several pixels share increase it.
    """
    imager = side_imager(sensor, prediction.side)
    size = 2 * int(np.ceil(4 * imager.smoothing_px + 2)) + 1
    point = np.zeros((size, size), np.float32)
    point[size // 2, size // 2] = 1
    kernel = mix_pixels(imager, point).astype(np.float64)
    grain_px = speckle.grain_size_px(
        wavelength_nm=sensor.projector.wavelength_nm,
        f_number=imager.lens.f_number,
        pixel_pitch_m=imager.pixel_pitch_m,
    )
    correlation = _grain_correlation(grain_px)
    padded = np.pad(kernel, _LAGS)
    total = sum(
        correlation[abs(dy)]
        * correlation[abs(dx)]
        * (padded * np.roll(padded, (dy, dx), (0, 1))).sum()
        for dy in range(-_LAGS, _LAGS + 1)
        for dx in range(-_LAGS, _LAGS + 1)
    )
    grain_factor = total / (kernel**2).sum()
    laser = prediction.sharp_laser_dn.astype(np.float64) ** 2
    return grain_factor * cv2.filter2D(laser, cv2.CV_64F, kernel**2, borderType=cv2.BORDER_REFLECT)


def _grain_correlation(grain_px: float) -> NDArray[np.float64]:
    """Return the correlation of speckle in pixels at distances 0, 1, 2, 3 along one axis.

    The average of the grain's Gaussian correlation over two pixels has a triangular weight.
    """
    sigma = grain_px / (2 * np.sqrt(2 * np.log(2)))
    offset = (np.arange(-200, 201) / 200)[None, :]
    lag = np.arange(_LAGS + 1)[:, None]
    triangle = 1 - np.abs(offset)
    covariance = (triangle * np.exp(-((lag + offset) ** 2) / (2 * sigma**2))).sum(axis=1)
    return covariance / covariance[0]
