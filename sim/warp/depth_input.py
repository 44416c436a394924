"""Depth images of a simulator: checks, conversions, and resampling to the sensor's camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import arrays, quantities
from starling.sim.arrays import Image
from starling.sim.scene import colours
from starling.sim.scene.visible import LUMINANCE
from starling.sim.sensor.sensor import Sensor

NEAREST_SURFACE_M = 1e-3  # Nearer surfaces are errors of the renderer.
_METRES = 50.0  # A larger median is in millimetres, or of sky [m].
_JUMP = 0.02  # A larger relative depth difference of neighbours separates surfaces.
REFLECTANCE = 0.5  # Of unknown surfaces.


@dataclass(frozen=True, slots=True, eq=False)
class InputCamera:
    """Camera of a depth image; its numbers are plausible for its size."""

    matrix: NDArray[np.float64]  # (3, 3) [px]
    shape: tuple[int, ...]  # (h, w)

    def __post_init__(self) -> None:
        k, (_, width) = self.matrix, self.shape
        with errors.naming("camera_matrix"):
            for name, focal_px in (("fx", k[0, 0]), ("fy", k[1, 1])):
                quantities.check_focal(name, float(focal_px), width)
            for name, place_px in (("cx", k[0, 2]), ("cy", k[1, 2])):
                quantities.check(name, float(place_px), "principal_point_px")


def checked_depth(
    name: str,
    depth_m: NDArray[np.floating],
    *,
    shape: tuple[int, ...] | None = None,
    empty: bool = False,
) -> Image:
    """Return depth [m] as float32, NaN without a surface (0, NaN and infinity), or refuse it.

    Args:
        name: name of the image in the user's words.
        depth_m: (h, w) image [m].
        shape: size that it must have; None for any.
        empty: allow an image without a surface.
    """
    depth = arrays.numbers(name, depth_m)
    if depth.ndim != 2:
        raise errors.refuse(
            name, "must be (h, w) numbers", f"{depth.shape} {depth.dtype}", "Give one image."
        )
    if shape is not None and depth.shape != shape:
        raise errors.refuse(name, f"must be {shape}, as depth_m", depth.shape, "Render it anew.")
    with np.errstate(over="ignore"):  # As infinity.
        out = depth.astype(np.float32)
    if (out < 0).any():
        raise errors.refuse(
            name, "must be >= 0", f"{out.min():g}", "Give distances along the optical axis."
        )
    out[(out == 0) | ~np.isfinite(out)] = np.nan
    known = out[np.isfinite(out)]
    if not known.size and empty:
        return out
    if not known.size:
        raise errors.refuse(name, "must hold a surface", "none", "Is the camera in a wall?")
    nearest = float(known.min())
    if nearest < np.float32(NEAREST_SURFACE_M):
        rule = f"must be 0 or >= {NEAREST_SURFACE_M:g} m"
        raise errors.refuse(name, rule, f"{nearest:g}", "Write 0 where there is no surface.")
    refuse_millimetres(name, known)
    return out


def refuse_millimetres(name: str, known: NDArray[np.floating]) -> None:
    """Refuse depth that cannot be in metres.

    Args:
        name: name of the image in error messages.
        known: depth of its surfaces, at least one.

    Raises:
        InputError: if the median is too far.
    """
    middle = float(np.median(known))
    if middle > _METRES:
        advice = (
            f"Divide millimetres by 1000. A median above {_METRES:g} m is refused too: "
            "set sky and far plane to NaN."
        )
        raise errors.refuse(name, "must be in metres", f"a median of {middle:g}", advice)


def reflectance(values: float | NDArray[Any] | None, camera: InputCamera, sensor: Sensor) -> Image:
    """Return the reflectance (h, w) in the sensor's camera and band.

    Args:
        values: None takes 0.5. A number or image (h, w) is the reflectance itself, from 0 to 1. An
            image (h, w, 3) of RGB bytes is a hint: 0.25 + 0.6 max(R, G, B), linear, because dyes
            that absorb visible light are bright at 850 nm. A passive camera of visible light sees
            their luminance.
        camera: camera of the depth image.
        sensor: its camera is that of the result.
    """
    shape = (sensor.height, sensor.width)
    if values is None:
        return np.full(shape, REFLECTANCE, np.float32)
    image = arrays.numbers("reflectance", values)
    if image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8:
        rgb = colours.linear(image)
        image = rgb @ LUMINANCE if sensor.projector.visible else colours.near_infrared(rgb)
    if image.ndim and image.shape != camera.shape:
        remedy = "Resize it; give RGB as (h, w, 3) uint8."
        raise errors.refuse(
            "reflectance", f"must be {camera.shape}, as the depth", image.shape, remedy
        )
    low, high = float(np.min(image)), float(np.max(image))
    if not (low >= 0 and high <= 1):
        raise errors.refuse(
            "reflectance",
            "must be in [0, 1]",
            f"{low:g} to {high:g}",
            "Give RGB as (h, w, 3) uint8, or divide by 255.",
        )
    if image.ndim == 0:
        return np.full(shape, float(image), np.float32)
    image = np.ascontiguousarray(image, np.float32)
    if matches(camera, sensor):
        return image
    x, y = _sources(camera, sensor)
    columns, rows = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
    moved = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32)


def matches(camera: InputCamera, sensor: Sensor) -> bool:
    """Whether an image of the camera is one of the sensor's."""
    k = camera.matrix
    expected = (sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px)
    same = np.allclose((k[0, 0], k[1, 1], k[0, 2], k[1, 2]), expected, rtol=1e-6, atol=1e-6)
    return same and camera.shape == (sensor.height, sensor.width)


def _sources(
    camera: InputCamera, sensor: Sensor
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns and rows in the camera's image of the sensor's columns and rows."""
    k = camera.matrix
    x = (np.arange(sensor.width) - sensor.cx_px) / sensor.fx_px * k[0, 0] + k[0, 2]
    y = (np.arange(sensor.height) - sensor.cy_px) / sensor.fy_px * k[1, 1] + k[1, 2]
    return x, y


def resampled(depth_m: Image, camera: InputCamera, sensor: Sensor) -> Image:
    """Resample depth to the sensor's camera; NaN outside the image.

    Inverse depth is linear on planes, so it is interpolated on surfaces. Across edges the nearest
    pixel counts.
    """
    if matches(camera, sensor):
        return depth_m
    x, y = _sources(camera, sensor)
    with np.errstate(invalid="ignore", divide="ignore"):
        nearness = np.nan_to_num(np.float32(1) / depth_m)
    moved = _interpolated(nearness, x.astype(np.float32), y.astype(np.float32), np.float32(_JUMP))
    with np.errstate(divide="ignore"):
        return np.where(moved > 0, np.float32(1) / moved, np.float32(np.nan))


@nb.njit(nogil=True, cache=True, inline="always")
def _between(place, count):  # pragma: no cover - compiled
    """Return the sample before a place, and the share of the sample after it."""
    before = min(max(int(np.floor(place)), 0), max(count - 2, 0))
    return before, min(max(place - np.float32(before), np.float32(0)), np.float32(1))


@nb.njit(nogil=True, cache=True)
def _interpolated(image, columns, rows, jump):  # pragma: no cover - compiled
    h, w = image.shape
    half = np.float32(0.5)
    out = np.zeros((len(rows), len(columns)), np.float32)
    for a in range(len(rows)):
        y = rows[a]
        if y < -half or y > h - half:
            continue
        j, v = _between(y, h)
        top, bottom = image[j], image[min(j + 1, h - 1)]
        for b in range(len(columns)):
            x = columns[b]
            if x < -half or x > w - half:
                continue
            i, u = _between(x, w)
            n = min(i + 1, w - 1)
            p, q, r, s = top[i], top[n], bottom[i], bottom[n]
            low, high = min(p, q, r, s), max(p, q, r, s)
            if high - low <= jump * high:
                upper = p + u * (q - p)
                out[a, b] = upper + v * (r + u * (s - r) - upper)
            else:
                near = top if v < half else bottom
                out[a, b] = near[i] if u < half else near[n]
    return out
