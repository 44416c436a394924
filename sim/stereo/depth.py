"""Depth maps with a reason for every missing pixel; conversion of disparity, depth, 16-bit code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors

if TYPE_CHECKING:  # The import loads numba.
    from starling.sim.stereo.post.temporal import History


LARGEST_CODE = 65535  # Largest code of the 16-bit depth image; 0 means no depth.


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthMap:
    """Depth in the left imager's frame, each (h, w). Missing pixels have NaN and a reason."""

    disparity_px: NDArray[np.float32]  # x_left - x_right.
    depth_m: NDArray[np.float32]  # z along the optical axis.
    valid: NDArray[np.bool_]
    reason: NDArray[np.uint32]  # Codes of `starling.sim.reason.Reason`; 0 if and only if valid.
    history: History | None = None  # Input of the temporal filter at the next frame.


def depth_from_disparity(
    disparity_px: NDArray[np.floating], *, focal_px: float, baseline_m: float
) -> NDArray[np.float32]:
    """Triangulate rectified disparity to depth along the optical axis: z = f b / d.

    Args:
        disparity_px: x_left - x_right [px], any shape, NaN without disparity.
        focal_px: focal length of the rectified pair [px], > 0.
        baseline_m: distance between the rectified centres [m], > 0.

    Returns:
        Depth [m], NaN where the input is NaN or <= 0 (at or beyond infinity).

    Raises:
        InputError: if focal_px or baseline_m is not finite and positive.

    Source: Szeliski, Computer Vision, 2nd ed., sec. 12.1.

    Example:
        >>> depth_from_disparity(np.array([[35.2]]), focal_px=640.0, baseline_m=0.055)
        array([[1.]], dtype=float32)
    """
    errors.positive("focal_px", focal_px)
    errors.positive("baseline_m", baseline_m)
    disparity = np.asarray(disparity_px, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.asarray(np.float32(focal_px * baseline_m) / disparity)
    np.putmask(depth, ~(disparity > 0), np.nan)  # In place: allocation would dominate the time.
    return depth


def disparity_from_depth(
    depth_m: NDArray[np.floating], *, focal_px: float, baseline_m: float
) -> NDArray[np.float32]:
    """Convert depth [m] to disparity [px], the inverse of `depth_from_disparity`: d = f b / z."""
    return depth_from_disparity(depth_m, focal_px=focal_px, baseline_m=baseline_m)


def to_code(depth_m: NDArray[np.floating], depth_unit_m: float) -> NDArray[np.uint16]:
    """Convert depth to its 16-bit code: depth / depth_unit_m, rounded; 0 means no depth."""
    errors.positive("depth_unit_m", depth_unit_m)
    code = np.asarray(np.divide(depth_m, depth_unit_m, dtype=np.float64))
    np.rint(code, out=code)  # In place, as in `depth_from_disparity`.
    np.putmask(code, ~((code >= 0) & (code <= LARGEST_CODE)), 0)
    return code.astype(np.uint16)


def from_code(code: NDArray[np.uint16], depth_unit_m: float) -> NDArray[np.float32]:
    """Convert the 16-bit code to depth [m]; code 0 becomes NaN."""
    errors.positive("depth_unit_m", depth_unit_m)
    depth = code.astype(np.float32) * np.float32(depth_unit_m)
    return np.where(code > 0, depth, np.float32(np.nan))
