"""Depth brought into the colour camera's image, as a device's driver does it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Colour, Sensor

_EMPTY = np.float32(np.inf)
_THREADS = 2


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
    near = np.array([sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px])
    far = np.array([colour.fx_px, colour.fy_px, colour.cx_px, colour.cy_px])

    def seen(rows: NDArray[np.intp]) -> Image:
        out = np.full((colour.height, colour.width), _EMPTY, np.float32)
        _splat(depth_m, rows[0], rows[-1] + 1, near, far, colour_from_left, out)
        return out

    # The nearest of all is the nearest of the parts' nearest, in whatever order they are seen.
    parts = np.array_split(np.arange(len(depth_m)), _THREADS)
    with ThreadPoolExecutor(_THREADS) as pool:
        nearest = np.minimum(*pool.map(seen, parts))
    np.putmask(nearest, np.isinf(nearest), np.nan)
    return nearest


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


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _splat(
    depth: NDArray, begin: int, end: int, near: NDArray, far: NDArray, pose: NDArray, out: NDArray
) -> None:  # pragma: no cover - compiled
    """Fill `out` with the least depth of all pixels of rows whose rectangle covers it."""
    rows, columns = out.shape
    edge = (np.arange(depth.shape[1] + 1) - 0.5 - near[2]) / near[0]
    for y in range(begin, end):
        above, below = (y - 0.5 - near[3]) / near[1], (y + 0.5 - near[3]) / near[1]
        for x in range(depth.shape[1]):
            z = depth[y, x]
            if not z > 0:
                continue
            left, top, first = _seen(edge[x] * z, above * z, z, far, pose)
            right, bottom, last = _seen(edge[x + 1] * z, below * z, z, far, pose)
            if first <= 0 or last <= 0:
                continue
            middle = np.float32(0.5 * (first + last))
            for row in range(max(0, top), min(rows, bottom + 1)):
                for column in range(max(0, left), min(columns, right + 1)):
                    if middle < out[row, column]:
                        out[row, column] = middle


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _seen(
    x: float, y: float, z: float, far: NDArray, pose: NDArray
) -> tuple[int, int, float]:  # pragma: no cover - compiled
    """Return the pixel of the far camera that a point of the near one falls in, and its z there."""
    ahead = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    u = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / ahead * far[0] + far[2]
    v = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / ahead * far[1] + far[3]
    return int(np.floor(u + 0.5)), int(np.floor(v + 0.5)), ahead
