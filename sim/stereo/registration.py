"""Registration of depth to the colour camera's image, as in a device's driver."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.geometry import frames
from starling.sim.sensor.sensor import Colour, Sensor

_EMPTY = np.float32(np.inf)
_THREADS = 2


def register(depth_m: Image, sensor: Sensor) -> Image:
    """Map depth from the left imager's image to the colour camera's image.

    Every depth pixel fills the rectangle that its corners span in the colour image, both ends
    included, and the nearest surface wins. Near edges therefore grow by about a pixel. A hole
    remains where the colour camera sees a surface that the depth camera does not. The algorithm is
    that of librealsense's `rs2::align` (src/proc/align.cpp). It does not model occlusion, so near
    surfaces can repeat colours from behind an edge.

    Args:
        depth_m: (h, w) z in the left imager's frame [m], NaN without depth.
        sensor: sensor with a colour camera.

    Returns:
        (height, width) of the colour camera: z in the colour camera's frame [m], NaN without depth.

    Raises:
        InputError: if the sensor has no colour camera.
    """
    colour = refuse_without(sensor)
    colour_from_left = np.linalg.inv(frames.pose(colour.position_m, colour.rotation_deg))
    near = np.array([sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px])
    far = np.array([colour.fx_px, colour.fy_px, colour.cx_px, colour.cy_px])

    def project(rows: NDArray[np.intp]) -> Image:
        out = np.full((colour.height, colour.width), _EMPTY, np.float32)
        _splat(depth_m, rows[0], rows[-1] + 1, near, far, colour_from_left, out)
        return out

    # The minimum over parts equals the minimum over all rows, so splitting changes no result.
    parts = np.array_split(np.arange(len(depth_m)), _THREADS)
    with ThreadPoolExecutor(_THREADS) as pool:
        nearest = np.minimum(*pool.map(project, parts))
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
    """Fill `out` with the least depth over all pixels of the rows whose rectangle covers it."""
    rows, columns = out.shape
    edge = (np.arange(depth.shape[1] + 1) - 0.5 - near[2]) / near[0]
    for y in range(begin, end):
        above, below = (y - 0.5 - near[3]) / near[1], (y + 0.5 - near[3]) / near[1]
        for x in range(depth.shape[1]):
            z = depth[y, x]
            if not z > 0:
                continue
            left, top, first = _project(edge[x] * z, above * z, z, far, pose)
            right, bottom, last = _project(edge[x + 1] * z, below * z, z, far, pose)
            if first <= 0 or last <= 0:
                continue
            middle = np.float32(0.5 * (first + last))
            for row in range(max(0, top), min(rows, bottom + 1)):
                for column in range(max(0, left), min(columns, right + 1)):
                    if middle < out[row, column]:
                        out[row, column] = middle


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _project(
    x: float, y: float, z: float, far: NDArray, pose: NDArray
) -> tuple[int, int, float]:  # pragma: no cover - compiled
    """Project a point of the near camera: pixel in the far camera, and z in its frame."""
    ahead = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    u = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / ahead * far[0] + far[2]
    v = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / ahead * far[1] + far[3]
    return int(np.floor(u + 0.5)), int(np.floor(v + 0.5)), ahead
