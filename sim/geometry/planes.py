"""Planes fitted around every pixel: which way a surface faces, and how rough it is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.filled import filled

Image = NDArray[np.float32]

NORMAL_RADIUS_PX = 3  # Of the windows that normals are taken over.
_UNEVEN_PX = 0.2  # A plane across a depth edge of 1 px leaves about this.


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """d(u + i, v + j) = disparity + across i + down j around each pixel, all (h, w)."""

    disparity_px: Image  # Of the plane at the pixel itself.
    across: Image  # Disparity gradient along the row [px / px].
    down: Image  # Along the column.
    residual_px: Image  # Root mean square of what the plane leaves.


def fit_planes(disparity_px: Image, known: NDArray[np.bool_], radius_px: int) -> Planes:
    """Fit a plane by least squares to the known pixels of each square window.

    A plane in space is a plane in disparity, whatever its slant, so a flat surface leaves nothing.
    Windows with too few known pixels for a plane take the fit of the nearest that has enough.

    Args:
        disparity_px: (h, w).
        known: (h, w), the pixels that count.
        radius_px: the window has 2 radius + 1 pixels a side.

    Raises:
        InputError: if no window has three known pixels off one line.
    """
    steps = np.arange(-radius_px, radius_px + 1, dtype=np.float64)
    weight = known.astype(np.float64)
    level = float(np.median(disparity_px[known])) if known.any() else 0.0
    # About the median: less is lost in the difference of squares below.
    value = np.where(known, disparity_px - level, 0.0).astype(np.float64)

    def moment(image: NDArray[np.float64], x_power: int, y_power: int) -> NDArray[np.float64]:
        kernels = steps**x_power, steps**y_power
        found = cv2.sepFilter2D(image, -1, *kernels, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(found, np.float64)

    n, x, y = moment(weight, 0, 0), moment(weight, 1, 0), moment(weight, 0, 1)
    xx, xy, yy = moment(weight, 2, 0), moment(weight, 1, 1), moment(weight, 0, 2)
    d, dx, dy = moment(value, 0, 0), moment(value, 1, 0), moment(value, 0, 1)
    dd = moment(value**2, 0, 0)
    count = np.maximum(n, 1)
    # Moments about the known pixels' own centre.
    sxx, sxy, syy = xx - x * x / count, xy - x * y / count, yy - y * y / count
    sdx, sdy, sdd = dx - d * x / count, dy - d * y / count, dd - d * d / count
    determinant = sxx * syy - sxy**2
    enough = (n >= 3) & (determinant > 0.1)
    safe = np.where(enough, determinant, 1.0)
    across = (sdx * syy - sdy * sxy) / safe
    down = (sdy * sxx - sdx * sxy) / safe
    at_pixel = level + (d - across * x - down * y) / count
    left_over = np.maximum(sdd - across * sdx - down * sdy, 0) / count
    images = at_pixel, across, down, np.sqrt(left_over)
    return Planes(*(filled(image.astype(np.float32), enough) for image in images))


def smoothest_nearby(planes: Planes, radius_px: int) -> Planes:
    """Give each pixel the best-fitting of the nine windows around that still hold it.

    A window across a depth edge fits badly, one beside it well, so normals stay true up to the edge
    (Kuwahara et al., Processing of RI-angiocardiographic images, 1976). Only windows that fit badly
    are replaced.
    """
    shifts = [(i, j) for j in (0, -radius_px, radius_px) for i in (0, -radius_px, radius_px)]
    best = Planes(*(np.array(image) for image in _shifted(planes, *shifts[0])))
    # A curved surface is no edge: there the pixel's own window knows best.
    uneven = best.residual_px > _UNEVEN_PX
    to_beat = np.where(uneven, np.float32(0.5) * best.residual_px, np.float32(0))
    for i, j in shifts[1:]:
        at_centre, across, down, residual = _shifted(planes, i, j)
        better = residual < to_beat
        here = at_centre - across * np.float32(i) - down * np.float32(j)
        for kept, other in (
            (best.disparity_px, here),
            (best.across, across),
            (best.down, down),
            (best.residual_px, residual),
            (to_beat, residual),
        ):
            np.copyto(kept, other, where=better)
    return best


def _shifted(planes: Planes, i: int, j: int) -> tuple[Image, Image, Image, Image]:
    """Images whose pixel (u, v) is the given ones' (u + i, v + j); beyond the border infinite."""
    height, width = planes.across.shape
    pad = max(abs(i), abs(j))
    rows, columns = slice(pad + j, pad + j + height), slice(pad + i, pad + i + width)

    def shift(image: Image, beyond: float) -> Image:
        return np.pad(image, pad, constant_values=beyond)[rows, columns]

    return (
        shift(planes.disparity_px, 0.0),
        shift(planes.across, 0.0),
        shift(planes.down, 0.0),
        shift(planes.residual_px, np.inf),
    )


def surface_planes(disparity_px: Image, known: NDArray[np.bool_]) -> Planes:
    """Fit each pixel's own surface over 7 px, on its side of depth edges.

    Raises:
        InputError: as `fit_planes`.
    """
    planes = fit_planes(disparity_px, known, NORMAL_RADIUS_PX)
    return smoothest_nearby(planes, NORMAL_RADIUS_PX)


def incidence_cosine(planes: Planes, camera: Pinhole) -> Image:
    """Cosine of the angle between the normal and the ray to the left imager, (h, w), 0 to 1.

    The plane d = d0 + a i + b j about pixel (u, v) has, in space, the normal
    (fx a, fy b, d0 - a (u - cx) - b (v - cy)) up to length; its product with the ray is d0.
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
