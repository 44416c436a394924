"""Pose of the reference depth relative to the camera, fitted to disparity.

The scanner is registered to each scene separately, to some millimetres and tenths of a degree. The
disparity change of a small rigid motion is linear in its six parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares.variable_projection import cut
from starling.sim.arrays import filled
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.metrics import MAD_TO_SIGMA, depth_edges
from starling.sim.scene.scene import ModelError

Map = NDArray[np.floating]

_CELL_PX = 32  # Side of the cells whose medians are fitted.
_LEAST_KNOWN = 0.5  # Share of a cell's pixels that must be known.
_CORRELATED_CELLS = 10.0  # Neighbouring cells that share one error.
_TURN_DEG, _SHIFT_M = 0.2, 3e-3  # Standard deviations of the prior.
_SMOOTHING_PX = 2.0  # Sigma of the filter before slopes are taken of a noisy reference.
_ITERATIONS = 10  # Reweighting steps; one more changes no reported digit.
_LEAST_PX = 0.02  # Lower limit of the cells' standard deviation.
_EDGE_PX = 1.0  # Disparity difference of neighbours from which they are separated by an edge.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedScene(CapturedScene):
    """A captured scene with its reference depth at the fitted pose."""

    pose: ModelError

    def truth_m(self) -> NDArray[np.float32] | None:
        """Return `CapturedScene.truth_m`, moved."""
        depth_m = CapturedScene.truth_m(self)
        return None if depth_m is None else move_depth(depth_m, self.info, self.pose)


def fit_pose(error_px: Map, depth_m: NDArray, info: CaptureInfo) -> ModelError | None:
    """Fit the rigid motion of a reference that explains the error of disparity.

    Args:
        error_px: (h, w) measured less reference disparity; NaN where unknown.
        depth_m: (h, w) reference depth; NaN where unknown.
        info: intrinsics of the captures.

    Returns:
        Shift and turn; None if too few cells are known.

    Source: the motion field of a rigid body (Longuet-Higgins and Prazdny, Proc. R. Soc. Lond. B
    208, 1980), by iteratively reweighted least squares (Holland and Welsch, Commun. Stat. A6,
    1977, Cauchy's weights) with a Gaussian prior.
    """
    known = np.isfinite(error_px) & np.isfinite(depth_m) & ~depth_edges(info.disparity_px(depth_m))
    full = cut(known, _CELL_PX).mean(axis=1) >= _LEAST_KNOWN
    if np.count_nonzero(full) < 6 * _CORRELATED_CELLS:
        return None
    error, *columns = (
        np.nanmedian(cut(np.where(known, values, np.nan), _CELL_PX)[full], axis=1)
        for values in (error_px, *_disparity_changes(depth_m, info))
    )
    matrix = np.stack(columns, axis=1)
    prior = np.diag(np.repeat([np.deg2rad(_TURN_DEG), _SHIFT_M], 3) ** -2.0)
    motion = np.zeros(6)
    for _ in range(_ITERATIONS):
        residual = error - matrix @ motion
        sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), _LEAST_PX)
        weight = 1 / (1 + (residual / (2 * sigma)) ** 2) / (_CORRELATED_CELLS * sigma**2)
        normal = (matrix * weight[:, None]).T @ matrix + prior
        motion = np.linalg.solve(normal, (matrix * weight[:, None]).T @ error)
    rx, ry, rz, x, y, z = (float(value) for value in (*np.rad2deg(motion[:3]), *motion[3:]))
    return ModelError(turn_deg=(rx, ry, rz), shift_m=(x, y, z))


def move_depth(
    depth_m: NDArray[np.float32], info: CaptureInfo, pose: ModelError
) -> NDArray[np.float32]:
    """Warp reference depth in the left view to a new pose.

    Args:
        depth_m: (h, w), NaN where unknown.
        info: intrinsics of the captures.
        pose: shift and turn; motion in the image must be at most some pixels.

    Returns:
        (h, w) depth [m].
    """
    turn, shift = np.deg2rad(pose.turn_deg), np.asarray(pose.shift_m)
    flow_x, flow_y, depth_change = _motion_field(_fill(depth_m), info, turn, shift)
    target = np.indices(depth_m.shape)[::-1].astype(np.float32)  # Columns, rows.
    source = target
    for _ in range(2):
        flow = [_sample(values, source, cv2.INTER_NEAREST) for values in (flow_x, flow_y)]
        source = target - np.stack(flow)
    disparity = info.disparity_px(depth_m)
    nearest = _sample(disparity, source, cv2.INTER_NEAREST)
    linear = _sample(disparity, source, cv2.INTER_LINEAR)
    moved = np.where(np.abs(linear - nearest) < _EDGE_PX, linear, nearest)
    change = _sample(depth_change, source, cv2.INTER_NEAREST)
    return np.asarray(info.focal_baseline_px_m / moved + change, np.float32)


def _disparity_changes(depth_m: NDArray, info: CaptureInfo) -> Iterator[Map]:
    """Yield the disparity change (h, w) at each left pixel by each of the six unit motions."""
    full = _fill(depth_m)
    disparity = np.asarray(cv2.GaussianBlur(info.disparity_px(full), (0, 0), _SMOOTHING_PX))
    slope_y, slope_x = np.gradient(disparity)
    for turn, shift in np.eye(6).reshape(6, 2, 3):
        flow_x, flow_y, depth_change = _motion_field(full, info, turn, shift)
        yield -slope_x * flow_x - slope_y * flow_y - disparity * depth_change / full


def _sample(image: Map, places: NDArray[np.float32], method: int) -> NDArray[np.float32]:
    """Sample an image at (columns, rows); NaN outside its border."""
    sampled = cv2.remap(
        np.asarray(image, np.float32),
        places[0],
        places[1],
        method,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(float("nan"),) * 4,
    )
    return np.asarray(sampled, np.float32)


def _motion_field(full_m: Map, info: CaptureInfo, turn: Map, shift: Map) -> tuple[Map, Map, Map]:
    """Compute image motion [px] in x and y, and change of depth [m], of each pixel's point."""
    y, x = np.indices(full_m.shape)
    ray_x, ray_y = (x - info.cx_px) / info.fx_px, (y - info.cy_px) / info.fy_px
    points = np.stack([ray_x * full_m, ray_y * full_m, full_m], axis=-1)
    motion = np.cross(turn, points) + shift
    depth_change = motion[..., 2]
    flow_x = info.fx_px * (motion[..., 0] - ray_x * depth_change) / full_m
    flow_y = info.fy_px * (motion[..., 1] - ray_y * depth_change) / full_m
    return flow_x, flow_y, depth_change


def _fill(depth_m: NDArray) -> Map:
    """Replace unknown depth by that of the nearest known pixel."""
    return filled(depth_m, np.isfinite(depth_m)).astype(np.float64)
