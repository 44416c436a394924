"""Depth brought into the colour camera's image, as a device's driver does it."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim import frames
from sim.layers import Image
from sim.sensor import Colour, Sensor

_EMPTY = np.float32(np.inf)


def register(depth_m: Image, sensor: Sensor) -> Image:
    """Bring depth from the left imager's image into the colour camera's.

    Every depth pixel becomes the rectangle that its corners span in the colour image, both ends
    included, and the nearest surface wins. So near edges grow by about a pixel, and behind them
    stays a hole where the colour camera sees what the depth camera did not. That is what
    librealsense's `rs2::align` does (src/proc/align.cpp); it knows nothing of occlusion, so that
    colours behind an edge may be doubled on the near surface.

    Args:
        depth_m: (h, w) z in the left imager's frame [m], NaN where there is none.
        sensor: with a colour camera.

    Returns:
        (height, width) of the colour camera: z in ITS frame [m], NaN where there is none.

    Raises:
        InputError: if the sensor has no colour camera.
    """
    colour = refuse_without(sensor)
    colour_from_left = np.linalg.inv(frames.pose(colour.position_m, colour.rotation_deg))
    out = np.full((colour.height, colour.width), _EMPTY, np.float32)
    _splat(
        depth_m,
        np.array([sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px]),
        np.array([colour.fx_px, colour.fy_px, colour.cx_px, colour.cy_px]),
        colour_from_left,
        out,
    )
    return np.where(np.isinf(out), np.float32(np.nan), out)


def refuse_without(sensor: Sensor) -> Colour:
    """Return the sensor's colour camera.

    Raises:
        InputError: if it has none.
    """
    if sensor.colour is None:
        raise errors.refuse(
            "post.registered",
            "needs a colour camera",
            f"none in {sensor.name}",
            "Add a [colour] table to the sensor.",
        )
    return sensor.colour


@nb.njit(nogil=True, cache=True)
def _splat(
    depth: NDArray, near: NDArray, far: NDArray, pose: NDArray, out: NDArray
) -> None:  # pragma: no cover - compiled
    """Fill `out` with the least depth of all pixels whose rectangle covers it."""
    height, width = depth.shape
    rows, columns = out.shape
    corner = np.zeros((2, 3))
    for y in range(height):
        for x in range(width):
            z = depth[y, x]
            if not z > 0:
                continue
            for end in range(2):
                u = (x - 0.5 + end - near[2]) / near[0] * z
                v = (y - 0.5 + end - near[3]) / near[1] * z
                for axis in range(3):
                    corner[end, axis] = (
                        pose[axis, 0] * u + pose[axis, 1] * v + pose[axis, 2] * z + pose[axis, 3]
                    )
            if corner[0, 2] <= 0 or corner[1, 2] <= 0:
                continue
            first = int(np.floor(corner[0, 0] / corner[0, 2] * far[0] + far[2] + 0.5))
            top = int(np.floor(corner[0, 1] / corner[0, 2] * far[1] + far[3] + 0.5))
            last = int(np.floor(corner[1, 0] / corner[1, 2] * far[0] + far[2] + 0.5))
            bottom = int(np.floor(corner[1, 1] / corner[1, 2] * far[1] + far[3] + 0.5))
            middle = np.float32(0.5 * (corner[0, 2] + corner[1, 2]))
            for row in range(max(0, top), min(rows, bottom + 1)):
                for column in range(max(0, first), min(columns, last + 1)):
                    out[row, column] = min(out[row, column], middle)
