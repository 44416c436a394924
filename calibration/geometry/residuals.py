"""Residuals of infrared images against the prediction of a sensor model, with derivatives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.calibration import parameters
from starling.calibration.least_squares import variable_projection
from starling.calibration.observation import Observation
from starling.calibration.parameters import DOT_BLUR, FIELD, CalibrationParameter
from starling.patterns import errors
from starling.sim import metrics
from starling.sim.differentiable import image as differentiable_image
from starling.sim.differentiable import light as differentiable
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.converter import apply_gamma
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.depth import disparity_from_depth

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]

_BURNT_SHARE = 0.98  # Saturation threshold over the highest code.
_REACH_PX = 3  # Width of the excluded margin along depth edges, shadow edges and the border.
_CAUCHY = 2.5  # Scale of the Cauchy weights [standard deviations].
_CLUSTER_SHARE = 0.075  # Side of a cluster of correlated residuals over the image width.
_BINS = 24  # Bins of level for the measured variance.
_LEAST_IN_BIN = 30  # Pixels that a bin must exceed for a robust variance.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ImagerView:
    """One imager's image of one scene."""

    scene: str
    side: differentiable.Side
    stage: Any
    reference: Pinhole | None  # Camera of the reference depth map; None for a metric surface.
    level: Array  # (h, w) level above black, linear in light [DN].
    usable: Mask  # (h, w) unsaturated pixels.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PredictedView:
    """Predicted light of a view, without the surface's reflectance."""

    view: ImagerView
    light: Array  # (h, w)
    columns: dict[str, Array]
    usable: Mask  # (h, w) pixels with valid image and derivatives.
    disparity_px: Array  # (h, w) disparity of the surface, NaN without a surface.
    body: NDArray[np.uint32]  # (h, w) number of the visible body.


@dataclass(frozen=True, slots=True)
class LevelVariance:
    """Variance of residuals at level L: a + b L + c L^2 [DN^2].

    The terms model read noise, shot noise and speckle.
    """

    a: float
    b: float
    c: float

    def at_level(self, level: Array) -> Array:
        """Return the variance (h, w) at levels above black."""
        above = np.maximum(level, 0)
        variance = np.float32(self.a) + np.float32(self.b) * above + np.float32(self.c) * above**2
        return np.maximum(variance, np.float32(1e-6))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ViewEquations:
    """Summed normal equations of p parameters, in units of their tolerances."""

    information: NDArray[np.float64]  # (p, p)
    gradient: NDArray[np.float64]  # (p,)
    scores: NDArray[np.float64]  # (clusters, p) gradient by cluster.
    shares: NDArray[np.float64]  # (clusters, p, p) information by cluster.
    stiffness: float  # Curvature of the robust cost over that of the weighted squares, below 1.
    cost: float  # Robust sum of squares.
    freedom: int  # Degrees of freedom: used pixels minus coefficients fitted in tiles.
    deviation: float  # Mean variance of the residuals' weights [DN^2].
    variances: tuple[LevelVariance, ...]  # One for each view.

    @staticmethod
    def total(parts: Sequence[ViewEquations]) -> ViewEquations:
        return ViewEquations(
            information=np.sum([part.information for part in parts], axis=0),
            gradient=np.sum([part.gradient for part in parts], axis=0),
            scores=np.concatenate([part.scores for part in parts]),
            shares=np.concatenate([part.shares for part in parts]),
            stiffness=float(
                np.average([part.stiffness for part in parts], weights=[p.freedom for p in parts])
            ),
            cost=float(sum(part.cost for part in parts)),
            freedom=sum(part.freedom for part in parts),
            deviation=float(
                np.average([part.deviation for part in parts], weights=[p.freedom for p in parts])
            ),
            variances=tuple(variance for part in parts for variance in part.variances),
        )


def make_views(observations: Iterable[Observation], sensor: Sensor) -> tuple[ImagerView, ...]:
    """Return the left and right views of observations.

    Raises:
        InputError: if there is no view, or an observation lacks infrared images or a surface.
    """
    imager_views = []
    for observation in observations:
        if observation.scene is None or observation.left is None:
            raise errors.refuse(
                f"scene {observation.name}",
                "must have infrared images and a posed mesh or reference depth",
                "less",
                "Leave it out, or fit only the groups that depth supports.",
            )
        stage = observation.stage
        reference = None if observation.metric else Pinhole.from_camera(observation.info)
        pair: tuple[tuple[differentiable.Side, Array | None, Imager], ...] = (
            ("left", observation.left, sensor.left),
            ("right", observation.right, sensor.right),
        )
        for side, level, part in pair:
            if level is None or (side == "right" and sensor.kind == "structured_light"):
                continue
            imager_views.append(
                ImagerView(
                    scene=observation.name,
                    side=side,
                    stage=stage,
                    reference=reference,
                    level=_linear(part, level),
                    usable=level < _BURNT_SHARE * part.saturation_dn,
                )
            )
    if not imager_views:
        raise errors.refuse("captures", "must hold a scene", "none", "Name a capture set.")
    return tuple(imager_views)


def _linear(part: Imager, level: Array) -> Array:
    """Return the level above black, linear in light (gamma inverted)."""
    above = level - np.float32(part.black_level_dn)
    return apply_gamma(above, 1 / part.gamma, part.ceiling_dn)


def predict(
    view: ImagerView,
    sensor: Sensor,
    free: Sequence[CalibrationParameter] = (),
    *,
    subpixels: int = 2,
) -> PredictedView:
    """Render the dots of a view and their derivatives by free parameters, per tolerance."""
    traced = differentiable.trace(
        view.stage, sensor, view.side, subpixels=subpixels, reference=view.reference
    )
    names = tuple(_DERIVED.get(row.name, row.name) for row in free)
    linear = differentiable_image.form(traced, names)
    columns = {
        row.name: linear.columns[name] * np.float32(_per_tolerance(row, sensor))
        for row, name in zip(free, names, strict=True)
    }
    disparity = disparity_from_depth(
        traced.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
    )
    usable = traced.clear & ~metrics.depth_edges(disparity)
    usable[:_REACH_PX] = usable[-_REACH_PX:] = False
    usable[:, :_REACH_PX] = usable[:, -_REACH_PX:] = False
    return PredictedView(
        view=view,
        light=linear.image,
        columns=columns,
        usable=_eroded(usable, _REACH_PX) & _eroded(view.usable, 1),
        disparity_px=disparity,
        body=traced.body,
    )


_DERIVED = {DOT_BLUR: differentiable_image.DOT_VARIANCE}


def _per_tolerance(row: CalibrationParameter, sensor: Sensor) -> float:
    """Return the change of a column's variable for a change of the parameter by its tolerance."""
    if row.name == FIELD:  # The column is the derivative by a relative change.
        return row.tolerance / parameters.value(sensor, FIELD)
    if row.name == DOT_BLUR:
        return row.tolerance**2  # Variance, because the derivative by the width is 0 at width 0.
    return row.tolerance


def tile_px(predicted: Sequence[PredictedView]) -> int:
    """Return the side of a tile with about six dots, from 12 to 48 px."""
    spacing = []
    for part in predicted:
        smooth = cv2.GaussianBlur(part.light, (0, 0), 1.0)
        top = (smooth >= cv2.dilate(smooth, np.ones((3, 3), np.uint8))) & part.usable
        spacing.append(np.sqrt(max(part.usable.sum(), 1) / max(top.sum(), 1)))
    return int(np.clip(4 * round(2.5 * float(np.median(spacing)) / 4), 12, 48))


def normal_equations(
    predicted: PredictedView,
    *,
    size_px: int,
    blur_px: float,
    variance: LevelVariance | None,
) -> ViewEquations:
    """Reduce a view to normal equations.

    Args:
        predicted: prediction of one view.
        size_px: side of a tile.
        blur_px: sigma of the Gaussian blur of image and prediction.
        variance: variance of the residual; None measures it.
    """
    view = predicted.view
    level, light = (_blurred(image, blur_px) for image in (view.level, predicted.light))
    columns = [_blurred(image, blur_px) for image in predicted.columns.values()]
    usable = _eroded(predicted.usable, round(2 * blur_px)) & _main_body(predicted.body, size_px)
    height = _blurred(level, 1.0)
    if variance is None:
        even = usable.astype(np.float32)
        plain = variable_projection.eliminate(level, [light], even, size_px=size_px)
        variance = _fit_variance(
            plain,
            variable_projection.cut(height, size_px),
            variable_projection.cut(usable, size_px) > 0,
        )
    expected = variance.at_level(height)
    weight = np.where(usable, 1 / expected, 0).astype(np.float32)
    first = variable_projection.eliminate(level, [light], weight, size_px=size_px)
    robust_weight = variable_projection.join(_cauchy_weight(first.residual), weight.shape, size_px)
    fitted = variable_projection.eliminate(level, [light], weight * robust_weight, size_px=size_px)
    residual = fitted.residual
    slope = fitted.project([[column] for column in columns])
    slope = slope * (fitted.amplitude.max(axis=1) > 0)[:, None, None]
    parts = (slope.transpose(0, 2, 1) @ residual[..., None])[..., 0].astype(np.float64)
    shares = (slope.transpose(0, 2, 1) @ slope).astype(np.float64)
    return ViewEquations(
        information=shares.sum(axis=0),
        gradient=parts.sum(axis=0),
        scores=_sum_clusters(parts, predicted, size_px),
        shares=_sum_clusters(shares, predicted, size_px),
        stiffness=_stiffness(first.residual),
        cost=_cauchy_cost(first.residual),
        freedom=max(first.freedom, 1),
        deviation=float(expected[usable > 0].mean()) if usable.any() else 1.0,
        variances=(variance,),
    )


def _main_body(body: NDArray[np.uint32], size_px: int) -> Mask:
    """Select pixels (h, w) of each tile's main body, because bodies differ in reflectance."""
    parts = np.sort(variable_projection.cut(body, size_px), axis=1)
    middle = parts[
        :, parts.shape[1] // 2
    ]  # The median is the body with more than half of the pixels.
    whole = np.broadcast_to(middle[:, None], parts.shape)
    return body == variable_projection.join(whole, body.shape, size_px)


def _sum_clusters(parts: NDArray[np.float64], predicted: PredictedView, size_px: int) -> NDArray:
    """Sum tiles' scores over squares of the left image, which pool both imagers' views."""
    shape = predicted.light.shape
    centre = variable_projection.centres((shape[0], shape[1]), size_px)
    if predicted.view.side == "right":
        known = np.nan_to_num(variable_projection.cut(predicted.disparity_px, size_px), nan=0.0)
        centre[:, 0] += np.median(known, axis=1)
    side = size_px * max(round(_CLUSTER_SHARE * shape[1] / size_px), 1)
    cell = np.floor(centre / side).astype(int)
    columns = shape[1] // side + 2
    number = np.clip(cell[:, 0], 0, columns - 1) + cell[:, 1] * columns
    sums = np.zeros((columns * (shape[0] // side + 1), *parts.shape[1:]))
    np.add.at(sums, number, parts)
    return sums


def _fit_variance(
    fitted: variable_projection.EliminatedTiles, height: Array, counted: Mask
) -> LevelVariance:
    """Fit the variance model to robust variances of the residuals in bins of level."""
    counted = counted & fitted.used[:, None]
    level, residual = height[counted], fitted.residual[counted]
    if level.size <= _LEAST_IN_BIN * _BINS:  # Not even one bin might be measured.
        return LevelVariance(max(float(np.var(residual)) if residual.size else 1.0, 1e-3), 0.0, 0.0)
    level = np.maximum(level, 0)
    edges = np.quantile(level, np.linspace(0, 1, _BINS + 1))
    bins = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, _BINS - 1)
    rows, spread = [], []
    for number in range(_BINS):
        inside = residual[bins == number]
        if inside.size > _LEAST_IN_BIN:
            rows.append(float(level[bins == number].mean()))
            spread.append((metrics.MAD_TO_SIGMA * float(np.median(np.abs(inside)))) ** 2)
    levels, measured = np.array(rows), np.maximum(np.array(spread), 1e-6)
    basis = np.stack([np.ones_like(levels), levels, levels**2], axis=1) / measured[:, None]
    (a, b, c), _ = optimize.nnls(basis, np.ones_like(measured))
    return LevelVariance(max(float(a), 1e-3), float(b), float(c))


def _cauchy_weight(residual: Array) -> Array:
    return np.asarray(1 / (1 + (residual / np.float32(_CAUCHY)) ** 2), np.float32)


def _stiffness(residual: Array) -> float:
    """Return the mean curvature of the robust cost over its mean weight."""
    square = (residual[residual != 0] / np.float32(_CAUCHY)) ** 2
    if square.size == 0:
        return 1.0
    return max(float(((1 - square) / (1 + square) ** 2).mean() / (1 / (1 + square)).mean()), 0.1)


def _cauchy_cost(residual: Array) -> float:
    return float(_CAUCHY**2 * np.log1p((residual.astype(np.float64) / _CAUCHY) ** 2).sum())


def _blurred(image: Array, sigma_px: float) -> Array:
    if sigma_px == 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _eroded(mask: Mask, reach_px: int) -> Mask:
    if reach_px == 0:
        return mask
    side = 2 * reach_px + 1
    return cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
