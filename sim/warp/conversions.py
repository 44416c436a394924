"""Depth along the optical axis from other outputs of renderers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import arrays
from starling.sim.arrays import Image
from starling.sim.sensor import edits
from starling.sim.warp.depth_input import InputCamera


def depth_from_zbuffer(zbuffer: NDArray[np.floating], near_m: float, far_m: float) -> Image:
    """Depth [m] (h, w) from an OpenGL depth buffer; NaN at the far plane.

    Args:
        zbuffer: (h, w) window depth, 0 at the near and 1 at the far plane. Of a reversed buffer
            give `1 - zbuffer`.
        near_m: distance of the near plane [m].
        far_m: distance of the far plane [m]; infinity is allowed.

    Raises:
        InputError: values outside [0, 1], or planes in the wrong order.

    Source: inverse of the projection matrix of glFrustum.
    """
    buffer = arrays.numbers("zbuffer", zbuffer).astype(np.float64)
    near_m, far_m = arrays.numbers("near_m, far_m", (near_m, far_m)).astype(np.float64)
    if not (0 < near_m < far_m):
        rule = "must be 0 < near_m < far_m"
        raise errors.refuse("near_m, far_m", rule, f"{near_m:g}, {far_m:g}", "Exchange them?")
    if buffer.ndim != 2 or not ((buffer >= 0) & (buffer <= 1)).all():
        low, high = (float(end(buffer, initial=0.0)) for end in (np.min, np.max))
        got = f"{buffer.shape}, {low:g} to {high:g}"
        raise errors.refuse("zbuffer", "must be (h, w), in [0, 1]", got, "Is it depth already?")
    with np.errstate(divide="ignore"):
        depth = near_m / (1 - buffer * (1 - near_m / far_m))
    return np.where(buffer < 1, depth, np.nan).astype(np.float32)


def depth_from_range(range_m: NDArray[np.floating], camera_matrix: NDArray[np.floating]) -> Image:
    """Depth along the optical axis [m] (h, w) from distances along each pixel's ray.

    Args:
        range_m: (h, w) distance from the camera's centre [m].
        camera_matrix: (3, 3) intrinsics [px].

    Raises:
        InputError: an image of another shape, or no camera matrix.
    """
    with np.errstate(over="ignore"):  # As infinity.
        distance = arrays.numbers("range_m", range_m).astype(np.float32)
    if distance.ndim != 2:
        raise errors.refuse("range_m", "must be (h, w)", distance.shape, "Give one image.")
    camera = InputCamera(edits.checked_matrix(camera_matrix), distance.shape)
    return distance / ray_length(camera.shape, camera.matrix)


def ray_length(shape: tuple[int, ...], camera_matrix: NDArray[np.floating]) -> Image:
    """Distance (h, w) along each pixel's ray of the plane at depth 1."""
    k, (h, w) = camera_matrix.astype(np.float32), shape
    x = (np.arange(w, dtype=np.float32) - k[0, 2]) / k[0, 0]
    y = (np.arange(h, dtype=np.float32) - k[1, 2]) / k[1, 1]
    return np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
