"""Photon transfer: electrons per DN, read noise and averaging, from repeats of a static scene.

The variance of shot noise equals its mean, so variance over level is DN per electron. The variance
at the black level is read noise. The level includes the mean dark current, and the variance its
shot noise. Averaging of pixels in the device reduces both variances. The noise correlation of
adjacent pixels gives the factor.

Source: EMVA Standard 1288, release 4.0, sec. 2 and 6 (photon transfer method); Janesick,
Photon Transfer (2007).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.imaging.imager import converter
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Imager, Sensor

_BLOCK_PX = 40  # Side of the blocks of the jackknife.
_BINS = 24  # Number of bins of level; a bin is at least one code wide.
_FEWEST = 2000  # Minimum number of samples in a bin.
_DETECTED = 2.0  # Detection limit of read noise [standard deviations].
_WIDEST_PX = 3.0  # Maximum sigma of averaging.
_HARMONICS = np.arange(1, 33, dtype=np.float64)  # Higher ones change the variance by < 5e-4.
_LARGEST = 1e8  # Variance above any converter's range [DN^2].


@dataclass(frozen=True, kw_only=True, slots=True)
class _Curve:
    """Line of variance over signal, before averaging and quantisation."""

    dn_per_electron: float
    read_dn2: float
    smoothing_px: float

    def row(self) -> NDArray[np.float64]:
        return np.array([self.dn_per_electron, self.read_dn2, self.smoothing_px])


def fit_photon_transfer(repeats: Sequence[NDArray], sensor: Sensor) -> Solution:
    """Fit full well (electrons at full scale), read noise and averaging to repeats.

    Changes of whole rows or of the whole image between frames (row noise, flicker) are removed
    first. The standard deviations come from a jackknife over blocks of the image.

    Args:
        repeats: left images (h, w) of a static scene, at least two; each is read three times.
        sensor: sensor with `gain`, `shot_noise`, range of codes and the fitted black level. The
            level of a dark frame includes dark current and is no black level.

    Returns:
        `left.full_well_e`, `left.read_noise_e`, `left.smoothing_px`.

    Raises:
        InputError: if there are fewer than two repeats, the repeats are equal, or too few pixels
            are unsaturated.
    """
    imager = sensor.left
    if len(repeats) < 2:
        raise errors.refuse("repeats", "must be at least 2", len(repeats), "Capture a scene twice.")
    sums = _sums(repeats, imager)
    blocks = len(sums)
    curve = _curve(sums.sum(axis=0), imager)
    rows = np.array([_curve(table, imager).row() for table in sums.sum(axis=0) - sums])
    spread = (blocks - 1) / blocks * (rows - rows.mean(0)).T @ (rows - rows.mean(0))
    return _solution(curve, spread, sensor)


def _solution(curve: _Curve, spread: NDArray, sensor: Sensor) -> Solution:
    """Convert the curve to parameters of the imager."""
    imager, gain = sensor.left, curve.dn_per_electron
    well = imager.gain * imager.ceiling_dn / gain
    read_e2 = curve.read_dn2 / gain**2
    to_read = np.array(
        [-2 * curve.read_dn2 / gain**3, 1 / gain**2, 0.0]
    )  # Derivative of read_e2 by the curve.
    sd_e2 = float(np.sqrt(to_read @ spread @ to_read))
    detected = read_e2 > _DETECTED * sd_e2
    read_e = float(np.sqrt(read_e2)) if detected else imager.read_noise_e
    to_values = np.array(
        [[-well / gain, 0, 0], to_read / (2 * read_e) if detected else 0 * to_read]
    )
    to_values = np.vstack([to_values, [0, 0, 1]])
    covariance = to_values @ spread @ to_values.T
    open_sentences = []
    if not detected:
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[1, 1] = np.inf
        bound = np.sqrt(max(read_e2, 0.0) + _DETECTED * sd_e2)
        open_sentences.append(
            f"left.read_noise_e is below {bound:.3g} electrons, the limit set by shot noise and "
            "quantisation: repeat captures in the dark, or stream more bits."
        )
    names = (
        ("left.full_well_e", well, "electrons", imager.full_well_e),
        ("left.read_noise_e", read_e, "electrons", imager.read_noise_e),
        ("left.smoothing_px", curve.smoothing_px, "px", imager.smoothing_px),
    )
    deviations = np.sqrt(np.diagonal(covariance))
    estimates = tuple(
        Estimate(name=name, value=value, sd=float(sd), unit=unit, start=start)
        for (name, value, unit, start), sd in zip(names, deviations, strict=True)
    )
    fitted = edits.with_values(sensor, [(estimate.name, estimate.value) for estimate in estimates])
    return Solution(
        estimates=estimates,
        covariance=covariance,
        undetermined=tuple(open_sentences),
        cost=(),
        sensor=fitted,
    )


def _sums(repeats: Sequence[NDArray], imager: Imager) -> NDArray[np.float64]:
    """Sum the differences of consecutive frames by block and bin of level.

    Returns (blocks, bins, 5): count, level, squared difference, neighbour product, pair count.
    """
    total = np.zeros(repeats[0].shape, np.float32)
    lowest, highest = repeats[0], repeats[0]
    for image in repeats:
        total += image
        lowest, highest = np.minimum(lowest, image), np.maximum(highest, image)
    mean = total / np.float32(len(repeats))
    level = cv2.blur(mean, (3, 3))  # Smoothed, so that noise does not change a pixel's bin.
    square = np.ones((5, 5), np.uint8)  # Averaging mixes saturated pixels with neighbours.
    clipped = ((highest >= imager.saturation_dn) | (lowest == 0)).astype(np.uint8)
    usable = cv2.dilate(clipped, square) == 0
    if usable.sum() < _FEWEST:
        raise errors.refuse(
            "repeats",
            f"must have {_FEWEST} pixels that are neither black nor saturated",
            int(usable.sum()),
            "Choose another exposure.",
        )
    low, high = np.quantile(level[usable], (0.001, 0.999))
    edges = np.arange(low, high + 1, max(1.0, (high - low) / _BINS))
    bins = np.clip(np.digitize(level, edges) - 1, 0, len(edges) - 1)
    height, width = mean.shape
    block_columns = -(-width // _BLOCK_PX)
    rows, columns = np.mgrid[:height, :width] // _BLOCK_PX
    key = (rows * block_columns + columns) * len(edges) + bins
    size = (int(rows.max()) + 1) * block_columns * len(edges)
    horizontal = usable[:, 1:] & usable[:, :-1]
    vertical = usable[1:] & usable[:-1]
    sums = np.zeros((size, 5))
    for first, second in itertools.pairwise(repeats):
        difference = _remove_global(
            second.astype(np.float32) - first.astype(np.float32), mean, usable
        )
        weights = (np.ones_like(level), level, difference**2)
        for column, weight in enumerate(weights):
            sums[:, column] += np.bincount(key[usable], weight[usable], size)
        for pair, pixel_key, product in (
            (horizontal, key[:, 1:], difference[:, 1:] * difference[:, :-1]),
            (vertical, key[1:], difference[1:] * difference[:-1]),
        ):
            sums[:, 3] += np.bincount(pixel_key[pair], product[pair], size)
            sums[:, 4] += np.bincount(pixel_key[pair], minlength=size)
    table = sums.reshape(-1, len(edges), 5)
    return table[table[:, :, 0].sum(axis=1) > 0]


def _remove_global(difference: NDArray, mean: NDArray, usable: NDArray) -> NDArray:
    """Remove the global change in proportion to the level, and the offset of each row."""
    remaining = np.where(usable, difference, 0)
    centred = np.where(usable, mean - mean[usable].mean(), 0)
    remaining = remaining - centred * np.float32(
        (remaining * centred).sum() / max((centred**2).sum(), 1e-9)
    )
    count = usable.sum(axis=1, keepdims=True)
    rows = remaining.sum(axis=1, keepdims=True) / np.maximum(count, 1)
    # Subtracting a row's mean reduces the noise variance of its pixels by (count - 1) / count.
    share = np.sqrt(count / np.maximum(count - 1, 1))
    return np.where(usable, (remaining - rows) * share, 0).astype(np.float32)


def _curve(table: NDArray[np.float64], imager: Imager) -> _Curve:
    """Fit the line to the variances of bins, and averaging to the covariance of neighbours."""
    table = table[table[:, 0] >= _FEWEST]
    if len(table) < 1:
        raise errors.refuse(
            "repeats", f"must have {_FEWEST} pixels of one level", 0, "Capture larger images."
        )
    count, level = table[:, 0], table[:, 1] / table[:, 0]
    # Half the mean squared difference of two frames is their temporal variance.
    variance = unquantised_variance(table[:, 2] / count / 2)
    if not variance.any():
        raise errors.refuse("repeats", "must differ", "equal frames", "Give frames, not copies.")
    neighbour_covariance = table[:, 3].sum() / max(table[:, 4].sum(), 1) / 2
    sigma_px = _smoothing_px(neighbour_covariance / float((variance * count).sum() / count.sum()))
    kept_variance = converter.variance_share(sigma_px) ** 2
    signal = level - imager.black_level_dn
    # The variance of n normal samples has the standard error variance x sqrt(2 / n).
    weight = np.sqrt(count) / np.maximum(variance + 1 / 12, 1e-6)
    columns = np.stack([signal * imager.shot_noise**2, np.ones_like(signal)], axis=1)
    slope, intercept = np.linalg.lstsq(
        columns * weight[:, None], variance / kept_variance * weight, rcond=None
    )[0]
    if slope <= 0:
        raise errors.refuse(
            "repeats",
            "must have more noise at higher levels",
            f"{slope:.3g} DN^2 per DN",
            "Capture a wider range of levels, with gamma off.",
        )
    return _Curve(
        dn_per_electron=float(slope), read_dn2=float(intercept), smoothing_px=float(sigma_px)
    )


def _smoothing_px(correlation: float) -> float:
    """Return the sigma of averaging [px] that gives a correlation of adjacent pixels' noise."""
    low, high = 0.0, _WIDEST_PX
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _neighbours(middle) < correlation else (low, middle)
    return (low + high) / 2 if correlation > _neighbours(0.2) else 0.0


def _neighbours(sigma_px: float) -> float:
    """Return the noise correlation of adjacent pixels after averaging by a Gaussian."""
    point = np.zeros((1, 41), np.float32)
    point[0, 20] = 1
    kernel = converter.smooth(np.repeat(point, 41, axis=0), sigma_px)[20].astype(np.float64)
    return float((kernel[1:] * kernel[:-1]).sum() / (kernel**2).sum())


def quantised_variance(variance_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the temporal variance of quantised codes, averaged over levels within a step.

    Noise of variance v and the quantisation error have the mean square v + 1/12. The part that is
    constant in time, the error of a pixel's mean code, is not visible in the temporal variance.
    By the Fourier series of the rounding error it is the sum of exp(-4 pi^2 k^2 v) / (2 pi^2 k^2).

    Args:
        variance_dn2: variance of normal noise before the converter [DN^2], any shape.

    Source: Widrow and Kollar, Quantization Noise (2008), ch. 4 and 5 (characteristic function).
    """
    squared = (np.pi * _HARMONICS) ** 2
    fixed = np.exp(-4 * squared * variance_dn2[..., None]) / (2 * squared)
    # The full series at 0 is exactly 1/12; the truncated harmonics hold the difference.
    truncation = 1 / 12 - (1 / (2 * squared)).sum()
    return variance_dn2 + 1 / 12 - fixed.sum(axis=-1) - np.where(variance_dn2 == 0, truncation, 0)


def unquantised_variance(quantised_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert `quantised_variance` [DN^2]; the result is at least 0."""
    target = np.asarray(quantised_dn2, np.float64)
    low, high = np.zeros_like(target), np.minimum(np.maximum(target, 0) + 1, _LARGEST)
    for _ in range(60):
        middle = (low + high) / 2
        over = quantised_variance(middle) > target
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return np.where(target > 0, (low + high) / 2, 0.0)
