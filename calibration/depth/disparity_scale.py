"""Regress scale and offset of a device's disparity against reference depth.

The device triangulates with the f * b in its captures, so its disparity is f * b / z. The model is
d_device = (1 + s) d_truth + o. Here s is the relative error of f * b, and o is a shift of the
disparity: a rectification offset, or the yaw angle times f.

Depth alone determines nothing else: f and b affect it only by their product.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import metrics

Array = NDArray[np.float32]
Column = NDArray[np.float64]
Mask = NDArray[np.bool_]

_EDGE_REACH_PX = 8  # Distance over which matching windows smear a depth edge.
_STRIDE_PX = 4  # Sampling step; errors of adjacent pixels are correlated.
_TILE_PX = 64  # Errors in different tiles are assumed to be independent.
_BINS = 12  # Bins of disparity for the spread of the errors.
_TUKEY = 4.685  # 95 % efficiency for normal errors (Huber, Robust Statistics).
_STEPS = 50  # Maximum number of reweighting steps.
_FEWEST = 500  # Minimum number of pixels.
_LEAST_RANGE = 0.15  # Minimum range of disparity over its median, to separate s from o.
_ALIKE = 1e-5  # Relative singular value below which columns are linearly dependent.
ROOMS = 3  # Minimum number of rooms for an estimate of the scatter between rooms.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DisparityPair:
    """Disparities of one scene, each (h, w) [px], NaN = unknown; all use the same f * b."""

    name: str
    room: str
    device_px: Array
    truth_px: Array
    expected_px: Array  # Simulated reading at the previous scale and offset.
    step_m: float  # Step of the depth codes of device and simulation [m].
    focal_baseline_px_m: float  # f * b of all three disparities.

    def counted(self) -> Mask:
        """Select pixels with all three values, away from depth edges of the reference."""
        known = np.isfinite(self.device_px + self.truth_px + self.expected_px)
        edge = metrics.depth_edges(self.truth_px).astype(np.uint8)
        return known & ~cv2.dilate(edge, _disc(_EDGE_REACH_PX)).astype(bool)


@dataclass(frozen=True, kw_only=True, eq=False)
class DisparityScale:
    """Fitted correction of disparity: d_device = d_expected + scale d_truth + offset_px."""

    scale: float  # Correction of the expected s.
    offset_px: float  # Correction of the expected o.
    covariance: NDArray[np.float64]  # (2, 2) of scale and offset_px; inf if not separable.
    bend_px: float  # RMS over the image of a smooth second-order residual [px].
    bend_sd_px: float  # Standard deviation of `bend_px` by chance.

    @cached_property
    def separable(self) -> bool:
        """Whether the range of distances separates scale from offset."""
        return bool(np.isfinite(self.covariance).all())


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Samples:
    """Pixels of all scenes, each (n,)."""

    truth_px: Column
    error_px: Column
    quantum_var: Column  # Quantisation variance of both depth codes [px^2].
    x: Column  # Image position, -1 ... 1.
    y: Column
    tile: NDArray[np.intp]
    room: NDArray[np.intp]


def fit(pairs: Sequence[DisparityPair], *, free: Sequence[str]) -> DisparityScale:
    """Fit scale and offset to all scenes together.

    The fit is a robust regression (iterated Tukey biweight). Its weights combine the errors' spread
    at each disparity with the quantisation of both depths, (d^2 step / f b)^2 / 12 each. The
    covariance is a sandwich clustered by tiles of 64 px. From three rooms on, the sandwich
    clustered by rooms replaces it if that one is larger.

    Args:
        pairs: scenes; a scene without common pixels does not contribute.
        free: fitted parameters, `scale`, `offset` or both; the other one stays 0. If all surfaces
            lie at about one distance, only the offset is fitted, and both deviations are infinite.

    Raises:
        InputError: if fewer than 500 pixels remain.

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
    both_free = {"scale", "offset"} <= set(free)
    separable = not both_free or _range(samples.truth_px) >= _LEAST_RANGE
    columns = _columns(samples, free if separable else ("offset",))
    theta, weight = _regress(samples, columns)
    residual = samples.error_px - columns @ theta
    covariance = np.zeros((2, 2))
    indices = [index for index, name in enumerate(("scale", "offset")) if name in free]
    value = np.zeros(2)
    value[indices if separable else [1]] = theta
    coefficient_covariance = (
        _clustered(samples, columns, weight, residual) if separable else np.diag([np.inf] * 2)
    )
    covariance[np.ix_(indices, indices)] = coefficient_covariance
    bend, chance = _bend(samples, columns, weight)
    return DisparityScale(
        scale=float(value[0]),
        offset_px=float(value[1]),
        covariance=covariance,
        bend_px=bend,
        bend_sd_px=chance,
    )


def _disc(reach: int) -> NDArray[np.uint8]:
    side = 2 * reach + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _samples(pairs: Sequence[DisparityPair]) -> _Samples:
    columns: list[list[NDArray]] = []
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
        columns.append(
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
    truth, error, quantum, x, y, tile, room = map(np.concatenate, zip(*columns, strict=True))
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
    """Return the coefficients and the final weights of the robust regression."""
    bins = _binned(samples.truth_px)
    middle = [_row(columns, samples.error_px, bins == number) for number in range(bins.max() + 1)]
    theta = np.linalg.lstsq(
        np.array([row for row, _ in middle]), np.array([value for _, value in middle]), rcond=None
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
    """Return the bin number of each disparity; bins have about equal counts."""
    limits = np.unique(np.quantile(disparity, np.linspace(0, 1, _BINS + 1)[1:-1]))
    _, number = np.unique(np.searchsorted(limits, disparity), return_inverse=True)
    return number


def _spread(residual: Column, bins: NDArray[np.intp], floor_var: Column) -> Column:
    """Return the standard deviation of each sample: that of its bin, at least the rounding's."""
    by_bin = np.array([nmad(residual[bins == number]) for number in range(bins.max() + 1)])
    return np.sqrt(np.maximum(by_bin[bins] ** 2, floor_var) + 1e-12)


def nmad(values: NDArray[np.floating[Any]]) -> float:
    """Return 1.4826 x the median absolute deviation."""
    return metrics.MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


def _clustered(
    samples: _Samples, columns: NDArray[np.float64], weight: Column, residual: Column
) -> NDArray[np.float64]:
    """Return the larger covariance of the coefficients, clustered by tiles or by rooms."""
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
    """Return the pseudo-inverse of the normal equations; undetermined directions are 0."""
    size = np.sqrt((weight[:, None] * columns**2).sum(axis=0))
    unit = columns / size
    inverse = np.linalg.pinv(unit.T @ (weight[:, None] * unit), rcond=_ALIKE, hermitian=True)
    return inverse / np.outer(size, size)


def _bend(samples: _Samples, columns: NDArray[np.float64], weight: Column) -> tuple[float, float]:
    """Fit x, y, x^2, x y, y^2 to the residual; return their RMS in the image, and by chance."""
    x, y = samples.x, samples.y
    # Shapes have zero mean over the square, so that they do not include an offset.
    shapes = np.stack([x, y, x * x - 1 / 3, x * y, y * y - 1 / 3], axis=1)
    square = np.diag([1 / 3, 1 / 3, 4 / 45, 1 / 9, 4 / 45])  # Mean products over the square.
    normal = _inverse(columns, weight) @ (columns.T * weight)
    # Remove what scale and offset can explain: on a slanted plane, x and y are the disparity.
    remaining_shapes = shapes - columns @ (normal @ shapes)
    residual = samples.error_px - columns @ (normal @ samples.error_px)
    theta = _inverse(remaining_shapes, weight) @ (remaining_shapes.T @ (weight * residual))
    covariance = _clustered(samples, remaining_shapes, weight, residual - remaining_shapes @ theta)
    variance = theta @ square @ theta
    return float(np.sqrt(variance)), float(np.sqrt(np.trace(square @ covariance)))
