"""Local plane fits of a disparity map: surface normal and roughness at each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Mask, filled
from starling.sim.geometry.pinhole import Pinhole

NORMAL_RADIUS_PX = 3  # Radius of the windows for surface normals [px].
_UNEVEN_PX = 0.2  # Residual of a plane across a depth edge of 1 px [px].


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """d(u + i, v + j) = disparity + across i + down j around each pixel, all (h, w)."""

    disparity_px: Image  # Disparity of the plane at the pixel.
    across: Image  # Disparity gradient along the row [px / px].
    down: Image  # Disparity gradient along the column [px / px].
    residual_px: Image  # Root mean square residual of the fit.


def fit_planes(disparity_px: Image, known: Mask, radius_px: int) -> Planes:
    """Fit a plane by least squares to the known pixels of each square window.

    A plane in space is a plane in disparity at any slant, so a flat surface has no residual.
    Windows with too few known pixels take the nearest valid fit.

    Args:
        disparity_px: (h, w).
        known: (h, w), pixels that count.
        radius_px: Radius of the window, whose side is 2 radius + 1 pixels.

    Raises:
        InputError: if no window has three known pixels off one line.
    """
    steps = np.arange(-radius_px, radius_px + 1, dtype=np.float64)
    weight = known.astype(np.float64)
    level = float(np.median(disparity_px[known])) if known.any() else 0.0
    # Centring at the median reduces cancellation in the differences of squares below.
    value = np.where(known, disparity_px - level, 0.0).astype(np.float64)

    def moment(image: NDArray[np.float64], x_power: int, y_power: int) -> NDArray[np.float64]:
        kernels = steps**x_power, steps**y_power
        sums = cv2.sepFilter2D(image, -1, *kernels, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(sums, np.float64)

    n, x, y = moment(weight, 0, 0), moment(weight, 1, 0), moment(weight, 0, 1)
    xx, xy, yy = moment(weight, 2, 0), moment(weight, 1, 1), moment(weight, 0, 2)
    d, dx, dy = moment(value, 0, 0), moment(value, 1, 0), moment(value, 0, 1)
    dd = moment(value**2, 0, 0)
    count = np.maximum(n, 1)
    # Moments about the centroid of the known pixels.
    sxx, sxy, syy = xx - x * x / count, xy - x * y / count, yy - y * y / count
    sdx, sdy, sdd = dx - d * x / count, dy - d * y / count, dd - d * d / count
    determinant = sxx * syy - sxy**2
    enough = (n >= 3) & (determinant > 0.1)
    safe = np.where(enough, determinant, 1.0)
    across = (sdx * syy - sdy * sxy) / safe
    down = (sdy * sxx - sdx * sxy) / safe
    fitted = level + (d - across * x - down * y) / count
    mean_square = np.maximum(sdd - across * sdx - down * sdy, 0) / count
    images = fitted, across, down, np.sqrt(mean_square)
    return Planes(*(filled(image.astype(np.float32), enough) for image in images))


def smoothest_nearby(planes: Planes, radius_px: int) -> Planes:
    """Replace bad fits by the best of the nine neighbouring windows that contain the pixel.

    A window across a depth edge fits badly, a window on one side fits well. Normals therefore stay
    correct up to the edge.

    Source: Kuwahara et al., Processing of RI-angiocardiographic images, 1976.
    """
    shifts = [(i, j) for j in (0, -radius_px, radius_px) for i in (0, -radius_px, radius_px)]
    best = Planes(*(np.array(image) for image in _shifted(planes, *shifts[0])))
    # On a curved surface the pixel's own window is best, so only bad fits are replaced.
    uneven = best.residual_px > _UNEVEN_PX
    to_beat = np.where(uneven, np.float32(0.5) * best.residual_px, np.float32(0))
    for i, j in shifts[1:]:
        at_centre, across, down, residual = _shifted(planes, i, j)
        better = residual < to_beat
        at_pixel = at_centre - across * np.float32(i) - down * np.float32(j)
        for target, candidate in (
            (best.disparity_px, at_pixel),
            (best.across, across),
            (best.down, down),
            (best.residual_px, residual),
            (to_beat, residual),
        ):
            np.copyto(target, candidate, where=better)
    return best


def _shifted(planes: Planes, i: int, j: int) -> tuple[Image, Image, Image, Image]:
    """Shift the images so that (u, v) holds (u + i, v + j); outside, the residual is infinite."""
    height, width = planes.across.shape
    pad = max(abs(i), abs(j))
    rows, columns = slice(pad + j, pad + j + height), slice(pad + i, pad + i + width)

    def shift(image: Image, outside: float) -> Image:
        return np.pad(image, pad, constant_values=outside)[rows, columns]

    return (
        shift(planes.disparity_px, 0.0),
        shift(planes.across, 0.0),
        shift(planes.down, 0.0),
        shift(planes.residual_px, np.inf),
    )


def surface_planes(disparity_px: Image, known: Mask) -> Planes:
    """Fit planes over windows of 7 px that do not cross depth edges.

    Raises:
        InputError: as `fit_planes`.
    """
    planes = fit_planes(disparity_px, known, NORMAL_RADIUS_PX)
    return smoothest_nearby(planes, NORMAL_RADIUS_PX)


def incidence_cosine(planes: Planes, camera: Pinhole) -> Image:
    """Cosine of the angle between the normal and the ray to the left imager, (h, w), 0 to 1.

    In space, the plane d = d0 + a i + b j at pixel (u, v) has this normal, up to length:
    (fx a, fy b, d0 - a (u - cx) - b (v - cy)). Its product with the ray is d0.
    """
    across = np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx_px)
    down = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy_px))[:, None]
    ahead = planes.disparity_px - planes.across * across - planes.down * down
    length = np.sqrt(
        (np.float32(camera.fx_px) * planes.across) ** 2
        + (np.float32(camera.fy_px) * planes.down) ** 2
        + ahead**2
    )
    ray = np.sqrt(1 + camera.tangent_squared())
    cosine = planes.disparity_px / np.maximum(length * ray, 1e-12)
    return np.clip(cosine, 0, 1).astype(np.float32)
