"""Scale and offset of a device's disparity, from its depth beside a reference depth.

The device triangulates with the f b that its captures name, so z f b is what it matched:
d_device = (1 + s) d_truth + o. Here s is the share by which the true f b is off the named one, and
o a shift of the disparity: rectification's offset, or a yaw of f times the angle.

Depth alone determines no more: f and b move it by their product only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import metrics

Array = NDArray[np.float32]
Column = NDArray[np.float64]
Mask = NDArray[np.bool_]

_EDGE_REACH_PX = 8  # As far as a matcher's windows smear a depth edge.
_STRIDE_PX = 4  # Errors of neighbours are alike: every fourth row and column tells as much.
_TILE_PX = 64  # Errors in different tiles are taken as independent.
_BINS = 12  # Of disparity, in which the spread of the errors is measured.
_TUKEY = 4.685  # 95 % efficient where errors are normal (Huber, Robust Statistics).
_STEPS = 50
_FEWEST = 500  # Pixels [count].
_LEAST_RANGE = 0.15  # Of disparities, over their median: below, s and o look alike.
_ALIKE = 1e-5  # Of the largest singular value: columns no more different tell nothing.
ROOMS = 3  # Fewer do not show how much rooms differ.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DisparityPair:
    """One scene's disparities, each (h, w) [px], NaN where unknown; all mean the same f b."""

    name: str
    room: str
    device_px: Array
    truth_px: Array
    expected_px: Array  # As a simulation reads it at a scale and offset tried before.
    step_m: float  # Of the device's and the simulation's depth codes [m].
    focal_baseline_px_m: float  # That all were made with.

    def counted(self) -> Mask:
        """Pixels with all three values, away from the truth's depth edges."""
        known = np.isfinite(self.device_px + self.truth_px + self.expected_px)
        edge = metrics.depth_edges(self.truth_px).astype(np.uint8)
        return known & ~cv2.dilate(edge, _disc(_EDGE_REACH_PX)).astype(bool)


@dataclass(frozen=True, kw_only=True, eq=False)
class DisparityScale:
    """What fits a device's disparity: d_device = d_expected + scale d_truth + offset_px."""

    scale: float  # To add to the s that was expected.
    offset_px: float  # To add to the o that was expected.
    covariance: NDArray[np.float64]  # (2, 2) of scale and offset_px; inf where not told apart.
    spread_px: float  # 1.4826 x median absolute residual [px].
    bend_px: float  # RMS over the image of a smooth second-order residual [px].
    bend_sd_px: float  # Its own standard deviation by chance.
    pixels: int  # Used.

    @cached_property
    def told_apart(self) -> bool:
        """Whether the captures span enough distances to tell scale from offset."""
        return bool(np.isfinite(self.covariance).all())


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Samples:
    """Pixels of all scenes, each (n,)."""

    truth_px: Column
    error_px: Column
    quantum_var: Column  # Variance of both codes' rounding [px^2].
    x: Column  # Place in the image, -1 ... 1.
    y: Column
    tile: NDArray[np.intp]
    room: NDArray[np.intp]


def fit(pairs: Sequence[DisparityPair], *, free: Sequence[str]) -> DisparityScale:
    """Fit scale and offset to all scenes together.

    Robust regression (Tukey's biweight, iterated) weighted by the errors' spread at each disparity
    and by the rounding of both depths, (d^2 step / f b)^2 / 12 each. Errors of one tile of 64 px,
    and where there are three rooms and more those of one room, are not taken as independent: the
    covariance is the larger of both clustered sandwiches.

    Args:
        pairs: scenes; those without common pixels add nothing.
        free: which of `scale` and `offset` are fitted; the other stays 0. Where all surfaces lie
            at about one distance the offset stands for both, and neither is told.

    Raises:
        InputError: if fewer than 500 pixels are left.

    Sources: Huber and Ronchetti, Robust Statistics, 2nd ed., ch. 7; Cameron and Miller 2015,
    Journal of Human Resources 50(2), eqs. 11 and 12 (clustered covariance).
    """
    samples = _samples(pairs)
    if len(samples.error_px) < _FEWEST:
        raise errors.refuse(
            "captures",
            f"must share {_FEWEST} pixels of device depth and reference away from edges",
            len(samples.error_px),
            "Is the reference in the left infrared view?",
        )
    together = {"scale", "offset"} <= set(free)
    apart = not together or _range(samples.truth_px) >= _LEAST_RANGE
    columns = _columns(samples, free if apart else ("offset",))
    theta, weight = _regress(samples, columns)
    residual = samples.error_px - columns @ theta
    covariance = np.zeros((2, 2))
    at = [index for index, name in enumerate(("scale", "offset")) if name in free]
    value = np.zeros(2)
    value[at if apart else [1]] = theta
    own = _clustered(samples, columns, weight, residual) if apart else np.diag([np.inf] * 2)
    covariance[np.ix_(at, at)] = own
    bend, chance = _bend(samples, columns, weight)
    return DisparityScale(
        scale=float(value[0]),
        offset_px=float(value[1]),
        covariance=covariance,
        spread_px=_nmad(residual),
        bend_px=bend,
        bend_sd_px=chance,
        pixels=len(residual),
    )


def _disc(reach: int) -> NDArray[np.uint8]:
    side = 2 * reach + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _samples(pairs: Sequence[DisparityPair]) -> _Samples:
    parts: list[list[NDArray]] = []
    rooms = sorted({pair.room for pair in pairs})
    for number, pair in enumerate(pairs):
        height, width = pair.truth_px.shape
        chosen = np.zeros((height, width), bool)
        chosen[::_STRIDE_PX, ::_STRIDE_PX] = True
        row, column = np.nonzero(chosen & pair.counted())
        truth = pair.truth_px[row, column].astype(np.float64)
        device = pair.device_px[row, column].astype(np.float64)
        expected = pair.expected_px[row, column].astype(np.float64)
        step = pair.step_m / pair.focal_baseline_px_m
        tile = (row // _TILE_PX) * 4096 + column // _TILE_PX + number * 4096**2
        parts.append(
            [
                truth,
                device - expected,
                (expected**4 + device**4) * step**2 / 12,
                2 * column / width - 1,
                2 * row / height - 1,
                tile,
                np.full(len(row), rooms.index(pair.room)),
            ]
        )
    truth, error, quantum, x, y, tile, room = map(np.concatenate, zip(*parts, strict=True))
    return _Samples(
        truth_px=truth, error_px=error, quantum_var=quantum, x=x, y=y, tile=tile, room=room
    )


def _range(disparity: Column) -> float:
    low, middle, high = np.percentile(disparity, (5, 50, 95))
    return float((high - low) / middle)


def _columns(samples: _Samples, free: Sequence[str]) -> NDArray[np.float64]:
    known = {"scale": samples.truth_px, "offset": np.ones_like(samples.truth_px)}
    return np.stack([known[name] for name in known if name in free], axis=1)


def _regress(samples: _Samples, columns: NDArray[np.float64]) -> tuple[Column, Column]:
    """Coefficients, and the weights that they were found with."""
    bins = _binned(samples.truth_px)
    middle = [_row(columns, samples.error_px, bins == number) for number in range(bins.max() + 1)]
    theta = np.linalg.lstsq(
        np.array([row for row, _ in middle]), np.array([at for _, at in middle]), rcond=None
    )[0].astype(np.float64)
    weight = np.ones(len(samples.error_px))
    for _ in range(_STEPS):
        residual = samples.error_px - columns @ theta
        sd = _spread(residual, bins, samples.quantum_var)
        share = np.clip(1 - (residual / (_TUKEY * sd)) ** 2, 0, None) ** 2
        weight = share / sd**2
        before, theta = theta, _inverse(columns, weight) @ (columns.T @ (weight * samples.error_px))
        if np.allclose(theta, before, rtol=1e-9, atol=1e-12):
            break
    return theta, weight


def _row(columns: NDArray[np.float64], error: Column, inside: Mask) -> tuple[Column, float]:
    return np.median(columns[inside], axis=0), float(np.median(error[inside]))


def _binned(disparity: Column) -> NDArray[np.intp]:
    """Number of the bin each disparity lies in; bins hold about equally many."""
    limits = np.unique(np.quantile(disparity, np.linspace(0, 1, _BINS + 1)[1:-1]))
    _, number = np.unique(np.searchsorted(limits, disparity), return_inverse=True)
    return number


def _spread(residual: Column, bins: NDArray[np.intp], floor_var: Column) -> Column:
    """Standard deviation of each sample: its bin's, but no less than the rounding's."""
    by_bin = np.array([_nmad(residual[bins == number]) for number in range(bins.max() + 1)])
    return np.sqrt(np.maximum(by_bin[bins] ** 2, floor_var) + 1e-12)


def _nmad(residual: Column) -> float:
    middle = np.median(residual)
    return metrics.MAD_TO_SIGMA * float(np.median(np.abs(residual - middle)))


def _clustered(
    samples: _Samples, columns: NDArray[np.float64], weight: Column, residual: Column
) -> NDArray[np.float64]:
    """Covariance of the coefficients: of tiles, or of rooms where those say more."""
    by_tile = _sandwich(columns, weight, residual, samples.tile)
    if len(np.unique(samples.room)) < ROOMS:
        return by_tile
    by_room = _sandwich(columns, weight, residual, samples.room)
    return max(by_tile, by_room, key=np.trace)


def _sandwich(
    columns: NDArray[np.float64], weight: Column, residual: Column, cluster: NDArray[np.intp]
) -> NDArray[np.float64]:
    bread = _inverse(columns, weight)
    _, number = np.unique(cluster, return_inverse=True)
    count = int(number.max()) + 1
    score = np.zeros((count, columns.shape[1]))
    np.add.at(score, number, (weight * residual)[:, None] * columns)
    return bread @ (score.T @ score) @ bread * (count / max(count - 1, 1))


def _inverse(columns: NDArray[np.float64], weight: Column) -> NDArray[np.float64]:
    """Inverse of the normal equations; what columns do not tell gets no part of it."""
    size = np.sqrt((weight[:, None] * columns**2).sum(axis=0))
    unit = columns / size
    inverse = np.linalg.pinv(unit.T @ (weight[:, None] * unit), rcond=_ALIKE, hermitian=True)
    return inverse / np.outer(size, size)


def _bend(samples: _Samples, columns: NDArray[np.float64], weight: Column) -> tuple[float, float]:
    """RMS over the image of a residual x, y, x^2, x y, y^2, and what chance would make of it."""
    x, y = samples.x, samples.y
    # Without mean over the square, so that an offset is none of them.
    shapes = np.stack([x, y, x * x - 1 / 3, x * y, y * y - 1 / 3], axis=1)
    square = np.diag([1 / 3, 1 / 3, 4 / 45, 1 / 9, 4 / 45])  # Mean products over the square.
    normal = _inverse(columns, weight) @ (columns.T * weight)
    # Only what scale and offset cannot take: on one leaning plane x and y are disparity itself.
    beside = shapes - columns @ (normal @ shapes)
    residual = samples.error_px - columns @ (normal @ samples.error_px)
    theta = _inverse(beside, weight) @ (beside.T @ (weight * residual))
    own = _clustered(samples, beside, weight, residual - beside @ theta)
    variance = theta @ square @ theta
    return float(np.sqrt(variance)), float(np.sqrt(np.trace(square @ own)))
