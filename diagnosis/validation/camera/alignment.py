"""Where an image lands: rotations, offsets, magnification and distortion, by one resampling."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.nominal import Nominal

Image = NDArray[np.float64]
_NEWTON_STEPS = 8  # From a start off by less than a pixel: far more than are needed.


@dataclass(frozen=True, kw_only=True, slots=True)
class Alignment:
    """What rectification leaves over in one image; the conventions' signs."""

    offset_x_px: float = 0.0  # Content moves right.
    offset_y_px: float = 0.0  # Content moves down.
    roll_deg: float = 0.0  # The imager turns clockwise.
    pitch_deg: float = 0.0  # It looks up.
    yaw_deg: float = 0.0  # It looks right.
    magnification: float = 1.0
    distortion_px: float = 0.0  # Outwards at half the diagonal.


def of_side(side: str, strengths: Strengths) -> Alignment:
    """Alignment of one imager: the lenses' scale is in both, all else in the right one alone."""
    both = Alignment(magnification=strengths.of("focal_scale"))
    if side == "left":
        return both
    return dataclasses.replace(
        both,
        offset_x_px=strengths.of("disparity_offset"),
        offset_y_px=strengths.of("vertical_offset"),
        roll_deg=strengths.of("roll"),
        pitch_deg=strengths.of("pitch"),
        yaw_deg=strengths.of("yaw"),
        distortion_px=strengths.of("distortion"),
    )


def land(image: Image, alignment: Alignment, nominal: Nominal) -> Image:
    """Resample an image (h, w) to where it lands.

    Turns are exact rotations of the rays and not their first order; distortion is undone by
    Newton's method; interpolation is by cubic splines. At the border the last pixel stands on.

    Returns:
        Image (h, w), clipped at 0; the very image given where nothing moves.
    """
    if alignment == Alignment():
        return image
    x, y = origin(alignment, nominal)
    moved = ndimage.map_coordinates(image, [y, x], order=3, mode="nearest")
    return np.clip(moved, 0.0, None)


def origin(
    alignment: Alignment, nominal: Nominal
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where in the aligned image each pixel's content comes from: x and y (h, w) [px]."""
    x = np.arange(nominal.width)[None, :] - alignment.offset_x_px - nominal.cx_px
    y = np.arange(nominal.height)[:, None] - alignment.offset_y_px - nominal.cy_px
    x, y = np.broadcast_arrays(x, y)
    shrink = _undistort(np.hypot(x, y), alignment.distortion_px, nominal.half_diagonal_px)
    scale = shrink / alignment.magnification
    rays = np.stack([x * scale / nominal.fx_px, y * scale / nominal.fy_px, np.ones(x.shape)], -1)
    angles = (alignment.pitch_deg, alignment.yaw_deg, alignment.roll_deg)
    if any(angles):
        rays = rays @ Rotation.from_rotvec(np.radians(angles)).as_matrix().T
    x = nominal.fx_px * rays[..., 0] / rays[..., 2] + nominal.cx_px
    y = nominal.fy_px * rays[..., 1] / rays[..., 2] + nominal.cy_px
    return x, y


def _undistort(radius: NDArray[np.float64], shift_px: float, unit_px: float) -> NDArray[np.float64]:
    """Factor that takes a distorted radius back: r + shift (r / unit)^3 = radius [px]."""
    if shift_px == 0.0:
        return np.ones(radius.shape)
    bend = shift_px / unit_px**3
    r = radius.copy()
    for _ in range(_NEWTON_STEPS):
        r -= (r + bend * r**3 - radius) / (1.0 + 3.0 * bend * r**2)
    return np.where(radius > 0, r / np.maximum(radius, math.ulp(1.0)), 1.0)
