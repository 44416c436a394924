"""Photon transfer: electrons per DN, read noise and averaging, from repeats of a scene at rest.

Shot noise has the variance of its mean, so that of DN grows with the level by DN per electron; at
the black level read noise is left. Dark current's mean is part of the level as light's is, and its
shot noise grows with it. A device that averages pixels keeps a part of either, and says how much
by the correlation of neighbouring pixels' noise.

Source: EMVA Standard 1288, release 4.0, sec. 2 and 6 (photon transfer method); Janesick,
Photon Transfer (2007).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.photometry import quantised_noise
from starling.calibration.photometry.levels import Side, part
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.imaging.imager import smoothing
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Imager, Sensor

_BLOCK_PX = 40  # Side of the blocks that are left out in turn.
_BINS = 24  # Of the level, each at least a step wide.
_FEWEST = 2000  # Samples below which a bin says nothing.
_DETECTED = 2.0  # Standard deviations above none at which a noise counts as seen.
_WIDEST_PX = 3.0  # Sigma of averaging that is looked for.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Sums:
    """Of each block and bin: count, level, squared difference, product of neighbours; (b, n, 4)."""

    of: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True)
class _Curve:
    """Line of variance against signal, before averaging and converter."""

    dn_per_electron: float
    read_dn2: float
    smoothing_px: float

    def row(self) -> NDArray[np.float64]:
        return np.array([self.dn_per_electron, self.read_dn2, self.smoothing_px])


def fit_photon_transfer(
    repeats: NDArray,
    sensor: Sensor,
    *,
    side: Side = "left",
    black_level_dn: float | None = None,
) -> Solution:
    """Fit full well (electrons that fill the scale), read noise and averaging to repeats.

    What goes with whole rows or with the whole image from frame to frame (row noise, flicker) is
    taken out before. The deviations are of a jackknife over blocks of the image.

    Args:
        repeats: (n, h, w) images of one imager, n >= 2, nothing moving.
        sensor: whose `gain`, `shot_noise` and range of codes hold.
        side: which imager.
        black_level_dn: as fitted elsewhere, without dark current's mean (not the level of a dark
            frame, which has it); the imager's own where None.

    Returns:
        `SIDE.full_well_e`, `SIDE.read_noise_e`, `SIDE.smoothing_px`.

    Raises:
        InputError: fewer than two repeats, equal ones, or too little that is not saturated.
    """
    imager = part(sensor, side)
    if repeats.ndim != 3 or len(repeats) < 2:
        raise errors.refuse(
            "repeats", "must be (n, h, w) with n >= 2", repeats.shape, "Capture a scene twice."
        )
    black = imager.black_level_dn if black_level_dn is None else black_level_dn
    sums = _sums(repeats, imager)
    blocks = len(sums.of)
    whole = _curve(sums.of.sum(axis=0), imager, black)
    without = sums.of.sum(axis=0) - sums.of
    rows = np.array([_curve(one, imager, black).row() for one in without])
    spread = (blocks - 1) / blocks * (rows - rows.mean(0)).T @ (rows - rows.mean(0))
    return _solution(whole, spread, sensor, side)


def _solution(curve: _Curve, spread: NDArray, sensor: Sensor, side: Side) -> Solution:
    """State the curve in the imager's terms."""
    imager, k = part(sensor, side), curve.dn_per_electron
    well = imager.gain * imager.ceiling_dn / k
    read_e2 = curve.read_dn2 / k**2
    to_read = np.array([-2 * curve.read_dn2 / k**3, 1 / k**2, 0.0])  # Of read_e2 by the curve.
    sd_e2 = float(np.sqrt(to_read @ spread @ to_read))
    seen = read_e2 > _DETECTED * sd_e2
    read_e = float(np.sqrt(read_e2)) if seen else imager.read_noise_e
    to_values = np.array([[-well / k, 0, 0], to_read / (2 * read_e) if seen else 0 * to_read])
    to_values = np.vstack([to_values, [0, 0, 1]])
    covariance = to_values @ spread @ to_values.T
    open_ = []
    if not seen:
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[1, 1] = np.inf
        most = np.sqrt(max(read_e2, 0.0) + _DETECTED * sd_e2)
        open_.append(
            f"{side}.read_noise_e is below {most:.3g} electrons, hidden by shot noise and whole "
            "codes: repeat captures in the dark, or stream more bits."
        )
    names = (
        (f"{side}.full_well_e", well, "electrons", imager.full_well_e),
        (f"{side}.read_noise_e", read_e, "electrons", imager.read_noise_e),
        (f"{side}.smoothing_px", curve.smoothing_px, "px", imager.smoothing_px),
    )
    deviations = np.sqrt(np.diagonal(covariance))
    estimates = tuple(
        Estimate(name=name, value=value, sd=float(sd), unit=unit, start=start)
        for (name, value, unit, start), sd in zip(names, deviations, strict=True)
    )
    fitted = edits.with_values(sensor, [(e.name, e.value) for e in estimates])
    return Solution(
        estimates=estimates,
        covariance=covariance,
        undetermined=tuple(open_),
        cost=(),
        sensor=fitted,
    )


def _sums(repeats: NDArray, imager: Imager) -> _Sums:
    """Collect squared differences of following frames by level and block."""
    mean = repeats.mean(axis=0, dtype=np.float32)
    level = cv2.blur(mean, (3, 3))  # Its own noise hardly moves a pixel to another bin.
    lowest, highest = repeats.min(axis=0), repeats.max(axis=0)
    square = np.ones((5, 5), np.uint8)  # Averaging has mixed saturated pixels with neighbours.
    clipped = ((highest >= imager.saturation_dn) | (lowest == 0)).astype(np.uint8)
    good = cv2.dilate(clipped, square) == 0
    if good.sum() < _FEWEST:
        raise errors.refuse(
            "repeats",
            f"must have {_FEWEST} pixels that are neither black nor saturated",
            int(good.sum()),
            "Choose another exposure.",
        )
    low, high = np.quantile(level[good], (0.001, 0.999))
    edges = np.arange(low, high + 1, max(1.0, (high - low) / _BINS))
    bins = np.clip(np.digitize(level, edges) - 1, 0, len(edges) - 1)
    height, width = mean.shape
    across = -(-width // _BLOCK_PX)
    rows, columns = np.mgrid[:height, :width] // _BLOCK_PX
    key = (rows * across + columns) * len(edges) + bins
    size = (int(rows.max()) + 1) * across * len(edges)
    beside = good[:, 1:] & good[:, :-1]
    below = good[1:] & good[:-1]
    out = np.zeros((size, 5))
    for first, second in itertools.pairwise(repeats):
        difference = _still(second.astype(np.float32) - first.astype(np.float32), mean, good)
        weights = (np.ones_like(level), level, difference**2)
        for column, weight in enumerate(weights):
            out[:, column] += np.bincount(key[good], weight[good], size)
        for pair, place, product in (
            (beside, key[:, 1:], difference[:, 1:] * difference[:, :-1]),
            (below, key[1:], difference[1:] * difference[:-1]),
        ):
            out[:, 3] += np.bincount(place[pair], product[pair], size)
            out[:, 4] += np.bincount(place[pair], minlength=size)
    table = out.reshape(-1, len(edges), 5)
    return _Sums(of=table[table[:, :, 0].sum(axis=1) > 0])


def _still(difference: NDArray, mean: NDArray, good: NDArray) -> NDArray:
    """Take out what the whole image did, in proportion to its level, and each row's offset."""
    kept = np.where(good, difference, 0)
    centred = np.where(good, mean - mean[good].mean(), 0)
    kept = kept - centred * np.float32((kept * centred).sum() / max((centred**2).sum(), 1e-9))
    count = good.sum(axis=1, keepdims=True)
    rows = kept.sum(axis=1, keepdims=True) / np.maximum(count, 1)
    # A row's mean takes a share of its pixels' own noise along.
    share = np.sqrt(count / np.maximum(count - 1, 1))
    return np.where(good, (kept - rows) * share, 0).astype(np.float32)


def _curve(table: NDArray[np.float64], imager: Imager, black_dn: float) -> _Curve:
    """Fit the line to the bins' variances, and the averaging to their neighbours' products."""
    table = table[table[:, 0] >= _FEWEST]
    if len(table) < 1:
        raise errors.refuse(
            "repeats", f"must have {_FEWEST} pixels of one level", 0, "Capture larger images."
        )
    count, level = table[:, 0], table[:, 1] / table[:, 0]
    # Half the squared difference of two codes is their variance in time.
    variance = quantised_noise.before(table[:, 2] / count / 2)
    if not variance.any():
        raise errors.refuse("repeats", "must differ", "equal frames", "Give frames, not copies.")
    beside = table[:, 3].sum() / max(table[:, 4].sum(), 1) / 2
    sigma_px = _smoothing_px(beside / float((variance * count).sum() / count.sum()))
    kept = smoothing.kept(sigma_px) ** 2
    signal = level - black_dn
    # A variance of n normal deviates has the deviation variance x sqrt(2 / n).
    trust = np.sqrt(count) / np.maximum(variance + 1 / 12, 1e-6)
    columns = np.stack([signal * imager.shot_noise**2, np.ones_like(signal)], axis=1)
    slope, intercept = np.linalg.lstsq(
        columns * trust[:, None], variance / kept * trust, rcond=None
    )[0]
    if slope <= 0:
        raise errors.refuse(
            "repeats",
            "must be noisier where they are brighter",
            f"{slope:.3g} DN^2 a DN",
            "Capture a wider range of levels, with gamma off.",
        )
    return _Curve(
        dn_per_electron=float(slope), read_dn2=float(intercept), smoothing_px=float(sigma_px)
    )


def _smoothing_px(correlation: float) -> float:
    """Sigma of the averaging [px] after which neighbours' noise correlates so."""
    low, high = 0.0, _WIDEST_PX
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _neighbours(middle) < correlation else (low, middle)
    return (low + high) / 2 if correlation > _neighbours(0.2) else 0.0


def _neighbours(sigma_px: float) -> float:
    """Correlation of neighbouring pixels' noise after averaging by the device's Gaussian."""
    point = np.zeros((1, 41), np.float32)
    point[0, 20] = 1
    kernel = smoothing.smoothed(np.repeat(point, 41, axis=0), sigma_px)[20].astype(np.float64)
    return float((kernel[1:] * kernel[:-1]).sum() / (kernel**2).sum())
