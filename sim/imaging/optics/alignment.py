"""Residual misalignment after rectification: the image is displaced.

A point with the ideal position p lands at q. The inverse map from q to p is:

1. Subtract the offset, the warp and the unit's waves (`waves`). The warp is a shift to the right,
   given at the cell centres of a regular grid. It is interpolated by a cubic and constant beyond
   the outer centres.
2. Remove the distortion. The radius r = |q - c| from the principal point c becomes
   r - s (r / r_h)^3. Here s is `distortion_px` (positive outwards) and r_h half the diagonal.
3. p = K R K_m^-1 q. K_m has m times K's focal lengths; R turns the imager: x_ideal = R x_imager.

(pitch, yaw, roll) is the rotation vector of R in the OpenCV frame, by the right-hand rule. To first
order, with (x, y) = p - c and f the focal length:

- pitch looks up and moves the image down by f pitch (1 + y^2 / f^2);
- yaw looks right and moves the image left by f yaw (1 + x^2 / f^2);
- roll turns the imager clockwise (as it looks) and the image the other way: a point moves by
  roll (y, -x).

Let the images of a pair move by (dx_l, dy_l) and (dx_r, dy_r). The disparity x_left - x_right
becomes d' = d + dx_l - dx_r, and rows differ by dy_l - dy_r:

- An offset o of the right imager gives d' = d - o, a yaw gives d' = d + f yaw. The depth error is
  -+ z^2 o / (f b) and grows with z^2.
- A magnification m of both imagers gives d' = m d. The depth is z / m, and its error grows with z.

Source: homography of a turned camera: Hartley and Zisserman, Multiple View Geometry, 2nd ed.,
sec. 8.4.2; radial distortion: sec. 7.4, first term.
"""

from __future__ import annotations

import dataclasses

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.optics import waves
from starling.sim.sensor.imager import Alignment

_ALIGNED = Alignment()


def homography(alignment: Alignment, pinhole: Pinhole) -> NDArray[np.float64]:
    """Return K R K_m^-1 (3, 3), from coordinates of the misaligned imager to ideal coordinates."""
    turned = frames.rotation((alignment.pitch_deg, alignment.yaw_deg, alignment.roll_deg))
    m = alignment.magnification
    camera = np.array(
        [[pinhole.fx_px, 0, pinhole.cx_px], [0, pinhole.fy_px, pinhole.cy_px], [0, 0, 1.0]]
    )
    return camera @ turned @ np.linalg.inv(camera @ np.diag([m, m, 1.0]))


def misalign(
    parts: tuple[Image, ...], alignment: Alignment, pinhole: Pinhole, die: Die
) -> tuple[Image, ...]:
    """Resample images as a misaligned imager records them; aligned images are returned as they are.

    Interpolation uses Lagrange polynomials through six by six samples. Its first five moments equal
    those of a point, so it neither shifts nor widens a dot. The edge of the rendered image is
    repeated beyond it.

    Args:
        parts: images (h, w) of separate lights.
        alignment: misalignment of the imager.
        pinhole: ideal intrinsics after rectification.
        die: unit and side, which select the waves.

    Source: Laakso et al., IEEE Signal Processing Magazine 13(1), 1996, sec. 3.3 (the Lagrange
    fractional delay is maximally flat at low frequencies).
    """
    if is_aligned(alignment):
        return parts
    warp_px = shift(alignment, pinhole, die)
    ideal_from_seen = homography(alignment, pinhole)
    inwards = alignment.distortion_px / pinhole.half_diagonal_px**3
    centre = np.array([pinhole.cx_px, pinhole.cy_px])
    offset = np.array([alignment.offset_x_px, alignment.offset_y_px])
    return tuple(
        _moved(_padded(part), ideal_from_seen, centre, offset, inwards, warp_px) for part in parts
    )


def undone(alignment: Alignment) -> Alignment:
    """Return the opposite offset, roll and warp, which bring an image back to its ideal places.

    The other errors stay; they are zero in calibrated sensors. Waves are random, so that they are
    none of a captured image. Roll and warp are opposite to first
    order.
    """
    return Alignment(
        offset_x_px=-alignment.offset_x_px,
        offset_y_px=-alignment.offset_y_px,
        roll_deg=-alignment.roll_deg,
        warp_px=tuple(tuple(-cell for cell in row) for row in alignment.warp_px),
    )


def is_aligned(alignment: Alignment) -> bool:
    """Return whether an alignment leaves images as they are."""
    names = ("waves_across_deg", "waves_down_deg")  # Neutral without waves.
    lengths = {name: getattr(_ALIGNED, name) for name in names}
    return dataclasses.replace(alignment, **lengths) == _ALIGNED


def shift(alignment: Alignment, pinhole: Pinhole, die: Die) -> Image:
    """Return the shift to the right [px] of every pixel (h, w): warp and waves."""
    shape = (pinhole.height, pinhole.width)
    return warp(alignment, shape) + waves.field(alignment, pinhole, die)


def warp(alignment: Alignment, shape: tuple[int, ...]) -> Image:
    """Return the shift to the right [px] of every pixel of an image (h, w), from `warp_px`."""
    if not alignment.warp_px:
        return np.zeros(shape, np.float32)
    cells = np.array(alignment.warp_px, np.float32)
    return np.asarray(cv2.resize(cells, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)


def _padded(image: Image) -> Image:
    """Repeat the edge as far as interpolation needs: 2 pixels before, 3 after."""
    around = cv2.copyMakeBorder(image, 2, 3, 2, 3, cv2.BORDER_REPLICATE)
    return np.asarray(around, np.float32)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _sources(
    row, shape, h, centre, offset, inwards, warp, i, j, t, s
):  # pragma: no cover - compiled
    """Ideal positions of a row's pixels, (column + i + t, j + s), clipped to the image."""
    bottom, right = shape[0] - 1.0, shape[1] - 1.0
    y = row - offset[1]
    down = y - centre[1]
    for column in range(len(i)):
        x = column - offset[0] - warp[row, column]
        across = x - centre[0]
        shrink = inwards * (across * across + down * down)
        a, b = x - shrink * across, y - shrink * down
        scale = 1 / (h[2, 0] * a + h[2, 1] * b + h[2, 2])
        u = min(max((h[0, 0] * a + h[0, 1] * b + h[0, 2]) * scale, 0.0), right)
        v = min(max((h[1, 0] * a + h[1, 1] * b + h[1, 2]) * scale, 0.0), bottom)
        whole_u, whole_v = np.int32(u), np.int32(v)
        i[column], j[column] = whole_u - np.int32(column), whole_v
        t[column], s[column] = u - whole_u, v - whole_v


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _weigh(t, weights):  # pragma: no cover - compiled
    """Lagrange weights (6, n) of the samples at -2 ... 3, for positions t (n,) in 0 ... 1."""
    unity, two, three = np.float32(1), np.float32(2), np.float32(3)
    for k in range(len(t)):
        a, b, c = t[k] + two, t[k] + unity, t[k]
        d, e, f = t[k] - unity, t[k] - two, t[k] - three
        left, right = a * b, e * f
        weights[0, k] = b * c * d * right * np.float32(-1 / 120)
        weights[1, k] = a * c * d * right * np.float32(1 / 24)
        weights[2, k] = left * d * right * np.float32(-1 / 12)
        weights[3, k] = left * c * right * np.float32(1 / 12)
        weights[4, k] = left * c * d * f * np.float32(-1 / 24)
        weights[5, k] = left * c * d * e * np.float32(1 / 120)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _run(padded, out, across, down, first, end, right, below):  # pragma: no cover - compiled
    """Interpolate a run of pixels with the same whole-pixel shift, so that loops vectorise."""
    out = out[first:end]
    a, b, c = across[0, first:end], across[1, first:end], across[2, first:end]
    d, e, f = across[3, first:end], across[4, first:end], across[5, first:end]
    out[:] = 0
    for j in range(6):
        samples, weight = padded[below + j, first + right :], down[j, first:end]
        for k in range(len(out)):
            line = a[k] * samples[k] + b[k] * samples[k + 1] + c[k] * samples[k + 2]
            line += d[k] * samples[k + 3] + e[k] * samples[k + 4] + f[k] * samples[k + 5]
            out[k] += weight[k] * line


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _moved(padded, h, centre, offset, inwards, warp):  # pragma: no cover - compiled
    shape = (padded.shape[0] - 5, padded.shape[1] - 5)
    width = shape[1]
    out = np.empty(shape, np.float32)
    i, j = np.empty(width, np.int32), np.empty(width, np.int32)
    t, s = np.empty(width, np.float32), np.empty(width, np.float32)
    across, down = np.empty((6, width), np.float32), np.empty((6, width), np.float32)
    for row in range(shape[0]):
        _sources(row, shape, h, centre, offset, inwards, warp, i, j, t, s)
        _weigh(t, across)
        _weigh(s, down)
        first = 0
        for column in range(1, width + 1):
            if column == width or i[column] != i[first] or j[column] != j[first]:
                _run(padded, out[row], across, down, first, column, i[first], j[first])
                first = column
    return out
