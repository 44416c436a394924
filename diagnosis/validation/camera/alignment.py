"""Rotation, offset, magnification and distortion of an image, in one resampling."""

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
_NEWTON_STEPS = 8  # More than enough from a start within a pixel of the solution.


@dataclass(frozen=True, kw_only=True, slots=True)
class ResidualAlignment:
    """Residual rectification error of one image, with the signs of the project conventions."""

    offset_x_px: float = 0.0  # Content moves right.
    offset_y_px: float = 0.0  # Content moves down.
    roll_deg: float = 0.0  # The imager turns clockwise.
    pitch_deg: float = 0.0  # It looks up.
    yaw_deg: float = 0.0  # It looks right.
    magnification: float = 1.0
    distortion_px: float = 0.0  # Outwards at half the diagonal.


def imager_alignment(side: str, strengths: Strengths) -> ResidualAlignment:
    """Return the residual alignment of one imager.

    Both images have the focal scale. All other terms apply to the right image only.
    """
    both = ResidualAlignment(magnification=strengths.value("focal_scale"))
    if side == "left":
        return both
    return dataclasses.replace(
        both,
        offset_x_px=strengths.value("disparity_offset"),
        offset_y_px=strengths.value("vertical_offset"),
        roll_deg=strengths.value("roll"),
        pitch_deg=strengths.value("pitch"),
        yaw_deg=strengths.value("yaw"),
        distortion_px=strengths.value("distortion"),
    )


def resample(image: Image, alignment: ResidualAlignment, nominal: Nominal) -> Image:
    """Resample an image (h, w) with a residual alignment.

    Rotations of the rays are exact, not first order. Newton's method inverts the distortion. The
    interpolation uses cubic splines and repeats the border pixel.

    Returns:
        Image (h, w), clipped at 0, or `image` itself if there is no residual alignment.
    """
    if alignment == ResidualAlignment():
        return image
    x, y = source_coordinates(alignment, nominal)
    moved = ndimage.map_coordinates(image, [y, x], order=3, mode="nearest")
    return np.clip(moved, 0.0, None)


def source_coordinates(
    alignment: ResidualAlignment, nominal: Nominal
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the position in the aligned image that each pixel shows: x and y (h, w) [px]."""
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
    """Return r / radius, where r solves r + shift (r / unit)^3 = radius [px]."""
    if shift_px == 0.0:
        return np.ones(radius.shape)
    bend = shift_px / unit_px**3
    r = radius.copy()
    for _ in range(_NEWTON_STEPS):
        r -= (r + bend * r**3 - radius) / (1.0 + 3.0 * bend * r**2)
    return np.where(radius > 0, r / np.maximum(radius, math.ulp(1.0)), 1.0)
