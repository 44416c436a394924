"""Layers of a depth image, as `starling.sim.render` has them of a scene."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Mask
from starling.sim.geometry import frames
from starling.sim.imaging.imager.converter import smoothing_weights
from starling.sim.render import emission
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.render.skylight import MATT_TILT
from starling.sim.scene.scene import Ambient
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth
from starling.sim.warp import kernels

JUMP_PX = 1.5  # A larger disparity difference of neighbours separates surfaces [px].
_PIXEL_VARIANCE = 1 / 12  # Variance of a pixel's box [px^2].
_CHUNKS = 4  # Parts of an image that threads share.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthScene:
    """Surfaces seen by the left imager, and light on them."""

    depth_m: Image  # (h, w) z, NaN without a surface.
    reflectance: Image  # (h, w)
    ambient: Ambient  # World frame: the left imager's.
    right_depth_m: Image | None = None  # (h, w) z seen from the right imager; None: warped.
    projector_depth_m: Image | None = None  # (h, w) z seen from the projector, left axes.


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Surfaces seen from one imager, on whole rows."""

    place: float  # [baselines]
    disparity: Image  # (h, w), 0 without a surface.
    normal: NDArray[np.float32]  # (h, w, 3), towards the imager; NaN without a surface.
    reflectance: Image


def layers(scene: DepthScene, sensor: Sensor) -> Layers:
    """Warp a depth image into the other views, and light it.

    What the left imager does not see continues the adjacent farther surface. Emitters off the
    baseline shadow as if they stood on it. Surfaces are matt.

    Args:
        scene: Depth and reflectance in the left view of the sensor's size and intrinsics.
        sensor: Geometry and projector; the layers are for 1 W.
    """
    rows = [slice(part[0], part[-1] + 1) for part in np.array_split(range(sensor.height), _CHUNKS)]
    with ThreadPoolExecutor(2) as pool:
        disparity = _disparity(scene.depth_m, sensor)
        left = _view(pool, rows, sensor, 0.0, disparity, scene.reflectance)
        hidden = _hidden_from_emitters(pool, rows, scene, sensor, disparity)
        laser, lit = _laser(pool, rows, sensor, left, hidden)
        layer_left = _layers(pool, rows, left, laser, scene.ambient, sensor)
        layer_right = None
        seen = np.zeros_like(lit)
        if sensor.kind == "stereo":
            right, seen = _right(pool, rows, scene, sensor, disparity)
            laser, _ = _laser(pool, rows, sensor, right, hidden)
            layer_right = _layers(pool, rows, right, laser, scene.ambient, sensor)
    return Layers(
        left=layer_left,
        right=layer_right,
        truth=Truth(
            depth_m=layer_left.depth_m,
            normal=left.normal,
            material=layer_left.body,
            right_sees=seen,
            lit=lit,
        ),
    )


def _disparity(depth_m: Image, sensor: Sensor) -> Image:
    """Disparity [px]; 0 without a surface."""
    rig = {"focal_px": sensor.fx_px, "baseline_m": sensor.true_baseline_m}
    return np.nan_to_num(disparity_from_depth(depth_m, **rig))


def _view(
    pool: ThreadPoolExecutor,
    rows: list[slice],
    sensor: Sensor,
    place: float,
    disparity: Image,
    reflectance: Image,
) -> _View:
    normal = np.empty((*disparity.shape, 3), np.float32)
    camera = _camera(sensor)

    def fill(part: slice) -> None:
        kernels.normals(disparity, part.start, part.stop, camera, normal)

    list(pool.map(fill, rows))
    return _View(place, disparity, normal, reflectance)


def _camera(sensor: Sensor) -> tuple[np.float32, ...]:
    values = (sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px)
    return tuple(map(np.float32, values))


def _right(
    pool: ThreadPoolExecutor,
    rows: list[slice],
    scene: DepthScene,
    sensor: Sensor,
    disparity: Image,
) -> tuple[_View, Mask]:
    """The right view, and the points of the left view that it sees (h, w)."""
    warped, reflectance = np.empty_like(disparity), np.empty_like(disparity)
    seen = np.zeros(disparity.shape, np.bool_)
    inner = np.empty_like(disparity)
    rendered = None
    if scene.right_depth_m is not None:
        rendered = _disparity(scene.right_depth_m, sensor)

    def clean(part: slice) -> None:
        jump_px = np.float32(JUMP_PX)
        kernels.inner_rows(disparity, scene.reflectance, jump_px, part.start, part.stop, inner)

    def fill(part: slice) -> None:
        kernels.right_rows(
            disparity,
            inner,
            warped if rendered is None else rendered,
            rendered is None,
            np.float32(JUMP_PX),
            part.start,
            part.stop,
            warped,
            reflectance,
            seen,
        )

    list(pool.map(clean, rows))
    list(pool.map(fill, rows))
    return _view(pool, rows, sensor, 1.0, warped, reflectance), seen


def _hidden_from_emitters(
    pool: ThreadPoolExecutor,
    rows: list[slice],
    scene: DepthScene,
    sensor: Sensor,
    disparity: Image,
) -> list[tuple[Image, np.float32]]:
    """Disparities that each emitter sees (h, n), and the left margin of its view [px]."""
    views: list[tuple[Image, np.float32]] = []
    reach = float(disparity.max(initial=0.0))
    for emitter in emitter_tables(sensor.projector):
        place = float(emitter[0]) / sensor.true_baseline_m
        margin = int(np.ceil(abs(place) * reach)) + 2
        out = np.zeros((sensor.height, sensor.width + 2 * margin), np.float32)
        if scene.projector_depth_m is not None:
            inner = slice(margin, margin + sensor.width)
            out[:, inner] = _disparity(scene.projector_depth_m, sensor)
        else:

            def fill(part: slice, out: Image = out, place: float = place, m: int = margin) -> None:
                kernels.emitter_rows(
                    disparity,
                    np.float32(place),
                    np.float32(m),
                    np.float32(JUMP_PX),
                    part.start,
                    part.stop,
                    out,
                )

            list(pool.map(fill, rows))
        views.append((out, np.float32(margin)))
    return views


def _laser(
    pool: ThreadPoolExecutor,
    rows: list[slice],
    sensor: Sensor,
    view: _View,
    hidden: list[tuple[Image, np.float32]],
) -> tuple[Image, Mask]:
    """Irradiance of the projector's light of 1 W (h, w) [W m^-2], and where it arrives."""
    baseline = sensor.true_baseline_m
    irradiance = np.zeros(view.disparity.shape, np.float32)
    lit = np.zeros(view.disparity.shape, np.bool_)
    for number, seen in enumerate(hidden):
        emitter = emitter_tables(sensor.projector)[number]
        constants = np.append(emitter, np.float32(emitter[0] / baseline))
        pattern = pattern_levels(sensor.projector, number, sensor.fx_px)

        def fill(
            part: slice, constants: Any = constants, pattern: Any = pattern, seen: Any = seen
        ) -> None:
            kernels.light_rows(
                view.disparity,
                view.normal,
                part.start,
                part.stop,
                (np.float32(view.place), np.float32(baseline)),
                _camera(sensor),
                np.float32(sensor.fx_px * baseline),
                constants,
                pattern,
                seen,
                irradiance,
                lit,
            )

        list(pool.map(fill, rows))
    return irradiance, lit


def _layers(
    pool: ThreadPoolExecutor,
    rows: list[slice],
    view: _View,
    irradiance: Image,
    ambient: Ambient,
    sensor: Sensor,
) -> ViewLayers:
    """Layers of a view; the irradiance's array becomes one of them."""
    sky, depth_m = np.empty_like(irradiance), np.empty_like(irradiance)
    gradient = tuple(np.float32(ambient.gradient * MATT_TILT * part) for part in ambient.up)
    focal_baseline = np.float32(sensor.fx_px * sensor.true_baseline_m)

    def fill(part: slice) -> None:
        kernels.radiance_rows(
            view.disparity,
            view.normal,
            view.reflectance,
            part.start,
            part.stop,
            focal_baseline,
            gradient,
            irradiance,
            sky,
            depth_m,
        )

    list(pool.map(fill, rows))
    none = np.broadcast_to(np.float32(0), irradiance.shape)
    return ViewLayers(
        projector_direct=irradiance,
        projector_indirect=none,
        ambient=sky,
        other=none,
        depth_m=depth_m,
        body=(view.disparity > 0).astype(np.uint32),
    )


@lru_cache(maxsize=8)
def emitter_tables(projector: Projector) -> list[NDArray[np.float32]]:
    """Origin, rotation by columns, half tangents and pattern scale of each emitter (15,)."""
    left_from_projector = frames.pose(projector.position_m, projector.rotation_deg)
    half = emission.half_tangents(projector)
    tables = []
    for emitter in emission.emitters(projector):
        pose = left_from_projector @ frames.pose(emitter.offset_m, emitter.rotation_deg)
        # Columns of the rotation from left to emitter: rows of its inverse.
        rotation = pose[:3, :3]
        table = [*pose[:3, 3], *rotation.ravel(), *half, projector.pattern_scale]
        tables.append(np.array(table, np.float32))
    return tables


@lru_cache(maxsize=8)
def pattern_levels(projector: Projector, number: int, fx_px: float) -> tuple[Any, ...]:
    """Levels of an emitter's pattern, averaged over a pixel, and their defocus."""
    if projector.defocus_mrad_m:
        defocus = emission.defocus_levels(projector, number)
        levels, ratio = defocus.levels, defocus.ratio
        width = projector.defocus_mrad_m / np.sqrt(defocus.variance_mrad2)
    else:
        levels, ratio, width = emission.irradiance_at_unit_distance(projector, number)[None], 2, 0
    half_x, half_y = emission.half_tangents(projector)
    sides = (2 * half_x * fx_px / levels.shape[2], 2 * half_y * fx_px / levels.shape[1])
    across, down = (_taps(_PIXEL_VARIANCE / side**2) for side in sides)
    blurred = [cv2.sepFilter2D(level, cv2.CV_32F, across, down) for level in levels]
    numbers = (1 / projector.focus_m, width, np.log(ratio))
    return np.ascontiguousarray(np.stack(blurred), np.float32), *map(np.float32, numbers)


def _taps(variance: float) -> Image:
    """Filter of this variance [texel^2]; a sampled Gaussian below 0.5 would have less."""
    if variance > 0.5:
        return smoothing_weights(float(np.sqrt(variance)))
    return np.array([variance / 2, 1 - variance, variance / 2], np.float32)
