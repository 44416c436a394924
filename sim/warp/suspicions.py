"""Warnings of depth images that are valid, but probably not what their user means."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.render.emission import half_tangents
from starling.sim.sensor.sensor import Sensor
from starling.sim.warp.conversions import ray_length
from starling.sim.warp.depth_input import InputCamera

_BACKGROUND_M = 10.0  # A farther plane that fills part of the image is no surface.
_SHARE = 0.01  # Least share of pixels that is reported.
_BUFFER = 0.9  # Most of a depth buffer lies above, for usual near planes.
_STRIDES = 24  # Image widths over which planes are tested.
_FLATTER = 0.25  # Ratio of curvatures below which an image holds ranges, or a buffer.
_ROUGH = 1e-3  # A larger relative curvature is no plane.
_CENTRE = (0.25, 0.75)  # Usual places of the principal point [image sides].
_LEVEL = 4  # Of `warnings.warn`: the caller of `Corruptor`.


def warn_of_depth(depth_m: Image, camera: InputCamera) -> None:
    """Warn of a far plane, a depth buffer and distances along rays.

    Args:
        depth_m: (h, w) [m], NaN without a surface.
        camera: its camera.
    """
    known = depth_m[np.isfinite(depth_m)]
    farthest = float(known.max())
    low = float(np.quantile(known[::16], 0.05))
    if farthest <= 1 and (_BUFFER < low < farthest or _is_flatter_as_buffer(depth_m)):
        _warn(
            "depth_m looks like a depth buffer. Convert it with starling.depth_from_zbuffer; "
            "if it falls with distance, give 1 minus it."
        )
        return
    share = float(np.mean(depth_m == np.float32(farthest)))
    if farthest > _BACKGROUND_M and share > _SHARE:
        _warn(
            f"depth_m is {farthest:g} m in {share:.0%} of all pixels, and taken as a surface. "
            "Set the far plane to NaN if it is none."
        )
    if _is_flatter_as_range(depth_m, camera):
        _warn(
            "depth_m looks like distances along rays: its planes are bent. "
            "Convert it with starling.depth_from_range."
        )


def warn_of_cameras(camera: InputCamera, sensor: Sensor) -> None:
    """Warn of a matrix for another image size, and of a sensor that sees more than is given.

    Args:
        camera: camera of the depth images.
        sensor: sensor that imitates a device.
    """
    (h, w), k = camera.shape, camera.matrix
    place = (k[0, 2] / w, k[1, 2] / h)
    if not all(_CENTRE[0] < part < _CENTRE[1] for part in place):
        _warn(
            f"camera_matrix has its principal point at ({k[0, 2]:g}, {k[1, 2]:g}) of {w}x{h} px. "
            "Is it for another image size?"
        )
    x = (np.arange(sensor.width) - sensor.cx_px) / sensor.fx_px
    y = (np.arange(sensor.height) - sensor.cy_px) / sensor.fy_px
    covered = _inside(x, k[0], w) * _inside(y, k[1], h)
    if covered < 1 - _SHARE:
        _warn(
            f"depth_m covers {covered:.0%} of the sensor's image; the rest has no surface. "
            "Render a wider view, or load the sensor with this camera_matrix."
        )
    half_x, half_y = half_tangents(sensor.projector)
    dotted = float(np.mean(np.abs(x) <= half_x) * np.mean(np.abs(y) <= half_y))
    if dotted < 1 - _SHARE:
        _warn(
            f"{1 - dotted:.0%} of the sensor's image has no dots: its view is wider than the "
            "projector's field."
        )


def _inside(tangents: NDArray[np.floating], row: NDArray[np.float64], count: int) -> float:
    """Share of tangents whose pixel lies in an image of `count` columns or rows."""
    focal, centre = row[row != 0][0], row[2]
    pixel = focal * tangents + centre
    return float(np.mean((pixel >= -0.5) & (pixel <= count - 0.5)))


def _is_flatter_as_range(depth_m: Image, camera: InputCamera) -> bool:
    """Whether most surfaces are planes, if the image holds distances along rays.

    The inverse depth of a plane is linear in the image.
    """
    nearness = np.float32(1) / depth_m
    as_range = nearness * ray_length(camera.shape, camera.matrix)
    bent, straight = (_curvature(image, nearness) for image in (nearness, as_range))
    return straight < _FLATTER * bent and straight < _ROUGH


def _is_flatter_as_buffer(depth_m: Image) -> bool:
    """Whether most surfaces are planes, if the image is linear in inverse depth, as buffers are."""
    nearness = np.float32(1) / depth_m
    bent, straight = _curvature(nearness, nearness), _curvature(depth_m, depth_m)
    if not straight < min(_FLATTER * bent, _ROUGH):
        return False
    # Depth in whole steps is straight between them: the bend has to be more than a step.
    rows = depth_m[::4]
    second = np.abs(np.diff(rows, 2, axis=1)) / rows[:, 1:-1]
    known = second[np.isfinite(second)]
    return bool(known.size) and bent > float(np.quantile(known, 0.9))


def _curvature(image: Image, scale: Image) -> float:
    """Median second difference over its scale, along rows; infinite if nothing is known."""
    step = max(image.shape[1] // _STRIDES, 1)
    rows = image[::step]
    second = rows[:, : -2 * step] - 2 * rows[:, step:-step] + rows[:, 2 * step :]
    relative = np.abs(second) / scale[::step, step:-step]
    known = relative[np.isfinite(relative)]
    return float(np.median(known)) if known.size else np.inf


def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=_LEVEL + 1)
