"""Infrared images against what a sensor would see of the same surface."""

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
from starling.calibration.parameters import DOT_BLUR, FIELD, Parameter
from starling.patterns import errors
from starling.sim import metrics
from starling.sim.differentiable import image as differentiable_image
from starling.sim.differentiable import light as differentiable
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.converter import bent
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.depth import disparity_from_depth

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]

_BURNT_SHARE = 0.98  # Of the highest code: levels from here on are clipped.
_REACH_PX = 3  # Pixels this near a depth or shadow edge, or the border, are left out.
_CAUCHY = 2.5  # Deviations beyond which a residual counts for less.
_CLUSTER_SHARE = 0.075  # Of the image's width: squares in which residuals may go together.
_BINS = 24  # Levels at which the residuals' variance is measured.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class View:
    """What one imager saw of one scene."""

    scene: str
    side: differentiable.Side
    stage: Any
    reference: Pinhole | None  # That a reference depth map was seen with; None: known in metres.
    level: Array  # (h, w) linear in light [DN].
    usable: Mask  # (h, w) not saturated.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Predicted:
    """What the sensor would see in a view, up to what a surface does to light."""

    view: View
    light: Array  # (h, w)
    columns: dict[str, Array]
    usable: Mask  # (h, w) where image and derivatives can be believed.
    disparity_px: Array  # (h, w) of this view's surface, NaN where there is none.
    body: NDArray[np.uint32]  # (h, w) number of the body.


@dataclass(frozen=True, slots=True)
class Variance:
    """Of residuals at level L: a + b L + c L^2 [DN^2], by read noise, shot noise and speckle."""

    a: float
    b: float
    c: float

    def at(self, level: Array) -> Array:
        """(h, w) at levels above black."""
        above = np.maximum(level, 0)
        whole = np.float32(self.a) + np.float32(self.b) * above + np.float32(self.c) * above**2
        return np.maximum(whole, np.float32(1e-6))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Normal:
    """Normal equations of residuals, summed: p parameters in units of their tolerances."""

    information: NDArray[np.float64]  # (p, p)
    gradient: NDArray[np.float64]  # (p,)
    scores: NDArray[np.float64]  # (clusters, p) the gradient's parts.
    shares: NDArray[np.float64]  # (clusters, p, p) the information's parts.
    stiffness: float  # The robust cost's curvature over what the weights say, below 1.
    cost: float  # Robust sum of squares.
    freedom: int  # Pixels that count, less what their tiles fitted to them.
    deviation: float  # Mean variance that residuals were weighed with [DN^2].
    variances: tuple[Variance, ...]  # Of each view.

    @staticmethod
    def total(parts: Sequence[Normal]) -> Normal:
        return Normal(
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
            variances=tuple(one for part in parts for one in part.variances),
        )


def views(observations: Iterable[Observation], sensor: Sensor) -> tuple[View, ...]:
    """Make the views of observations, left and right.

    Raises:
        InputError: if there is none, or one lacks infrared images or a surface.
    """
    found = []
    for seen in observations:
        if seen.scene is None or seen.left is None:
            raise errors.refuse(
                f"scene {seen.name}",
                "must have infrared images and a posed mesh or reference depth",
                "less",
                "Leave it out, or fit what depth alone can tell.",
            )
        stage = seen.stage
        reference = None if seen.metric else Pinhole.of(seen.info)
        pair: tuple[tuple[differentiable.Side, Array | None, Imager], ...] = (
            ("left", seen.left, sensor.left),
            ("right", seen.right, sensor.right),
        )
        for side, level, part in pair:
            if level is None or (side == "right" and sensor.kind == "structured_light"):
                continue
            found.append(
                View(
                    scene=seen.name,
                    side=side,
                    stage=stage,
                    reference=reference,
                    level=_linear(part, level),
                    usable=level < _BURNT_SHARE * part.saturation_dn,
                )
            )
    if not found:
        raise errors.refuse("captures", "must hold a scene", "none", "Name a capture set.")
    return tuple(found)


def _linear(part: Imager, level: Array) -> Array:
    """Level above black that goes with the light, gamma undone."""
    above = level - np.float32(part.black_level_dn)
    return bent(above, 1 / part.gamma, part.ceiling_dn)


def predict(
    view: View, sensor: Sensor, free: Sequence[Parameter] = (), *, subpixels: int = 2
) -> Predicted:
    """Render a view's dots and their derivatives by free parameters, in units of tolerance."""
    traced = differentiable.trace(
        view.stage, sensor, view.side, subpixels=subpixels, reference=view.reference
    )
    asked = tuple(_DERIVED.get(row.name, row.name) for row in free)
    linear = differentiable_image.formed(traced, asked)
    columns = {
        row.name: linear.columns[name] * np.float32(_per_tolerance(row, sensor))
        for row, name in zip(free, asked, strict=True)
    }
    disparity = disparity_from_depth(
        traced.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
    )
    good = traced.clear & ~metrics.depth_edges(disparity)
    good[:_REACH_PX] = good[-_REACH_PX:] = False
    good[:, :_REACH_PX] = good[:, -_REACH_PX:] = False
    return Predicted(
        view=view,
        light=linear.image,
        columns=columns,
        usable=_eroded(good, _REACH_PX) & _eroded(view.usable, 1),
        disparity_px=disparity,
        body=traced.body,
    )


_DERIVED = {DOT_BLUR: differentiable_image.DOT_VARIANCE}


def _per_tolerance(row: Parameter, sensor: Sensor) -> float:
    """How far a column's own variable moves while a parameter moves by its tolerance."""
    if row.name == FIELD:  # The column is of a relative step.
        return row.tolerance / parameters.value(sensor, FIELD)
    if row.name == DOT_BLUR:
        return row.tolerance**2  # In variance, which unlike the width moves the image from 0 on.
    return row.tolerance


def tile_px(predicted: Sequence[Predicted]) -> int:
    """Side of a tile that holds about six dots, from 12 to 48 px."""
    spacing = []
    for part in predicted:
        smooth = cv2.GaussianBlur(part.light, (0, 0), 1.0)
        top = (smooth >= cv2.dilate(smooth, np.ones((3, 3), np.uint8))) & part.usable
        spacing.append(np.sqrt(max(part.usable.sum(), 1) / max(top.sum(), 1)))
    return int(np.clip(4 * round(2.5 * float(np.median(spacing)) / 4), 12, 48))


def normal(
    predicted: Predicted,
    *,
    size_px: int,
    blur_px: float,
    variance: Variance | None,
) -> Normal:
    """Reduce a view to normal equations.

    Args:
        predicted: of one view.
        size_px: side of a tile.
        blur_px: sigma of a Gaussian that image and model alike are blurred by first.
        variance: of the residual; None measures it.
    """
    view = predicted.view
    level, light = (_blurred(image, blur_px) for image in (view.level, predicted.light))
    columns = [_blurred(image, blur_px) for image in predicted.columns.values()]
    usable = _eroded(predicted.usable, round(2 * blur_px)) & _main_body(predicted.body, size_px)
    height = _blurred(level, 1.0)
    if variance is None:
        even = usable.astype(np.float32)
        plain = variable_projection.eliminate(level, [light], even, size_px=size_px)
        variance = _variance(
            plain,
            variable_projection.cut(height, size_px),
            variable_projection.cut(usable, size_px) > 0,
        )
    expected = variance.at(height)
    weight = np.where(usable, 1 / expected, 0).astype(np.float32)
    first = variable_projection.eliminate(level, [light], weight, size_px=size_px)
    down = variable_projection.joined(_cauchy_weight(first.residual), weight.shape, size_px)
    fitted = variable_projection.eliminate(level, [light], weight * down, size_px=size_px)
    residual = fitted.residual
    slope = fitted.projected([[column] for column in columns])
    slope = slope * (fitted.amplitude.max(axis=1) > 0)[:, None, None]
    parts = (slope.transpose(0, 2, 1) @ residual[..., None])[..., 0].astype(np.float64)
    shares = (slope.transpose(0, 2, 1) @ slope).astype(np.float64)
    return Normal(
        information=shares.sum(axis=0),
        gradient=parts.sum(axis=0),
        scores=_clustered(parts, predicted, size_px),
        shares=_clustered(shares, predicted, size_px),
        stiffness=_stiffness(first.residual),
        cost=_cauchy_cost(first.residual),
        freedom=max(first.freedom, 1),
        deviation=float(expected[usable > 0].mean()) if usable.any() else 1.0,
        variances=(variance,),
    )


def _main_body(body: NDArray[np.uint32], size_px: int) -> Mask:
    """Pixels (h, w) of the body that fills most of their tile: others return light otherwise."""
    parts = np.sort(variable_projection.cut(body, size_px), axis=1)
    middle = parts[:, parts.shape[1] // 2]  # Of two bodies, the one with more than half.
    whole = np.broadcast_to(middle[:, None], parts.shape)
    return body == variable_projection.joined(whole, body.shape, size_px)


def _clustered(parts: NDArray[np.float64], predicted: Predicted, size_px: int) -> NDArray:
    """Sum tiles' scores over squares of the left image: both imagers' views of one place."""
    shape = predicted.light.shape
    centre = variable_projection.centres((shape[0], shape[1]), size_px)
    if predicted.view.side == "right":
        known = np.nan_to_num(variable_projection.cut(predicted.disparity_px, size_px), nan=0.0)
        centre[:, 0] += np.median(known, axis=1)
    side = size_px * max(round(_CLUSTER_SHARE * shape[1] / size_px), 1)
    place = np.floor(centre / side).astype(int)
    wide = shape[1] // side + 2
    number = np.clip(place[:, 0], 0, wide - 1) + place[:, 1] * wide
    out = np.zeros((wide * (shape[0] // side + 1), *parts.shape[1:]))
    np.add.at(out, number, parts)
    return out


def _variance(fitted: variable_projection.Eliminated, height: Array, counted: Mask) -> Variance:
    """Fit the residuals' robust variance at growing levels."""
    counted = counted & fitted.used[:, None]
    level, residual = height[counted], fitted.residual[counted]
    if level.size < 10 * _BINS:
        return Variance(max(float(np.var(residual)) if residual.size else 1.0, 1e-3), 0.0, 0.0)
    level = np.maximum(level, 0)
    edges = np.quantile(level, np.linspace(0, 1, _BINS + 1))
    bins = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, _BINS - 1)
    rows, spread = [], []
    for number in range(_BINS):
        inside = residual[bins == number]
        if inside.size > 30:
            rows.append(float(level[bins == number].mean()))
            spread.append((metrics.MAD_TO_SIGMA * float(np.median(np.abs(inside)))) ** 2)
    at, wanted = np.array(rows), np.maximum(np.array(spread), 1e-6)
    basis = np.stack([np.ones_like(at), at, at**2], axis=1) / wanted[:, None]
    (a, b, c), _ = optimize.nnls(basis, np.ones_like(wanted))
    return Variance(max(float(a), 1e-3), float(b), float(c))


def _cauchy_weight(residual: Array) -> Array:
    return np.asarray(1 / (1 + (residual / np.float32(_CAUCHY)) ** 2), np.float32)


def _stiffness(residual: Array) -> float:
    """Mean curvature of the robust cost over its mean weight, where there are residuals."""
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
