"""One imager's image of a captured scene, with the surface point of each pixel.

The dots on a surface scale with its reflectance. Subtracting the local mean and dividing by the
local deviation leaves the pattern, if the surface has no texture of the size of dots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation
from starling.calibration.observation import Observation, Side
from starling.patterns import errors
from starling.sim import metrics
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.render.layers import ViewLayers

Array = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_LIT = 0.5  # Minimum lit share of a pixel.
_NEAR_SHADOW_PX = 2  # Width of the excluded margin along shadow edges (reference uncertainty).
_BURNT_SHARE = 0.98  # Saturation threshold over the highest code.
_LEAST_DEVIATION_DN = 0.5  # Minimum deviation; a smaller one is quantisation.
_STEP_DN2 = 1 / 12  # Quantisation variance.
_MOST_WEIGHT = 50.0  # Maximum weight: texture and model errors limit a strong pattern.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PatternView:
    """One imager's image with its surface points."""

    scene: str
    room: str
    side: Side
    level_dn: Array  # (h, w), including the black level.
    points_m: Array  # (h, w, 3) in the left imager's frame; NaN where unknown.
    usable: Mask  # Known, lit and unsaturated pixels away from edges of depth and shadow.


class Modulation(NamedTuple):
    """A view's image, normalised by local mean and deviation."""

    value: Array  # (h, w), with unit local deviation.
    weight: Array  # (h, w), inverse noise variance; 0 for unusable pixels.


def make_views(observation: Observation, sensor: Sensor) -> tuple[PatternView, ...]:
    """Return the left and right view of an observation, with the sensor's geometry.

    Args:
        observation: scene with infrared images and a surface.
        sensor: sensor with the assumed intrinsics, baseline, alignment and projector.

    Raises:
        InputError: if infrared images or surface are missing.
    """
    from starling.sim.render import direct

    if observation.scene is None or observation.left is None:
        raise errors.refuse(
            f"scene {observation.name}",
            "must have infrared images and reference depth or a posed mesh",
            "less",
            "Fit only the groups that depth supports.",
        )
    layers = direct.layers(observation.stage, sensor, subpixels=1)
    views = [_view(observation, sensor, "left", observation.left, layers.left)]
    if observation.right is not None and layers.right is not None:
        views.append(_view(observation, sensor, "right", observation.right, layers.right))
    return tuple(views)


def modulate(view: PatternView, *, dn_per_electron: float, black_level_dn: float) -> Modulation:
    """Normalise a view by local mean and deviation.

    Args:
        view: view with dots.
        dn_per_electron: conversion gain, for the shot noise [DN / electron].
        black_level_dn: black level of the image.
    """
    varying = correlation.without_mean(view.level_dn)
    deviation = np.sqrt(correlation.local_square(varying))
    above = correlation.local_mean(view.level_dn) - np.float32(black_level_dn)
    noise = _STEP_DN2 + np.float32(dn_per_electron) * np.maximum(above, 0)
    weight = np.minimum(deviation**2 / noise, _MOST_WEIGHT)
    return Modulation(
        value=varying / np.maximum(deviation, _LEAST_DEVIATION_DN),
        weight=np.where(view.usable, weight, 0).astype(np.float32),
    )


def _view(
    observation: Observation,
    sensor: Sensor,
    side: Side,
    level_dn: Array,
    rendered: ViewLayers,
) -> PatternView:
    lit = (rendered.projector_direct > 0).astype(np.float32)
    shift_m = sensor.true_baseline_m if side == "right" else 0.0
    points, lit = _misalign(_points(rendered.depth_m, sensor, shift_m), lit, sensor, side)
    depth = points[..., 2]
    disparity = disparity_from_depth(depth, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m)
    usable = np.isfinite(depth) & ~metrics.depth_edges(disparity)
    side_px = 2 * _NEAR_SHADOW_PX + 1
    well_lit = (lit > _LIT).astype(np.uint8)
    usable &= cv2.erode(well_lit, np.ones((side_px, side_px), np.uint8)).astype(bool)
    usable &= level_dn < _BURNT_SHARE * sensor.left.ceiling_dn
    if side == "left" and observation.truth_m is not None and not observation.metric:
        usable &= np.isfinite(observation.truth_m)
    return PatternView(
        scene=observation.name,
        room=observation.room,
        side=side,
        level_dn=level_dn,
        points_m=points,
        usable=usable,
    )


def _misalign(points_m: Array, lit: Array, sensor: Sensor, side: Side) -> tuple[Array, Array]:
    """Resample points and light at the pixels of a misaligned imager."""
    from starling.sim.geometry.pinhole import Pinhole
    from starling.sim.imaging.imager.charge import Die
    from starling.sim.imaging.optics import alignment

    aligned = sensor.left.alignment if side == "left" else sensor.right.alignment
    if alignment.is_aligned(aligned):
        return points_m, lit
    x, y, z = (np.ascontiguousarray(points_m[..., axis]) for axis in range(3))
    x[[0, -1]] = np.nan  # Points outside the border are unknown.
    x[:, [0, -1]] = np.nan
    die, pinhole = Die(sensor.unit, side), Pinhole.from_camera(sensor)
    x, y, z, lit = alignment.misalign((x, y, z, lit), aligned, pinhole, die)
    return np.where(np.isfinite(x)[..., None], np.stack([x, y, z], axis=-1), np.nan), lit


def _points(depth_m: Array, sensor: Sensor, shift_m: float) -> Array:
    height, width = depth_m.shape
    x = (np.arange(width, dtype=np.float32) - np.float32(sensor.cx_px)) / np.float32(sensor.fx_px)
    y = (np.arange(height, dtype=np.float32) - np.float32(sensor.cy_px)) / np.float32(sensor.fy_px)
    points = np.empty((height, width, 3), np.float32)
    points[..., 0] = x[None, :] * depth_m + np.float32(shift_m)
    points[..., 1] = y[:, None] * depth_m
    points[..., 2] = depth_m
    return points
