"""How a scene's reference stands to the camera: fitted by disparity, and put right.

A scanner's place is found for each scene by itself, to some millimetres and tenths of a degree.
What a small motion does to a disparity map is linear in its six numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares.variable_projection import cut
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.metrics import MAD_TO_SIGMA, depth_edges
from starling.sim.scene.scene import ModelError
from starling.sim.stereo.filled import filled

Map = NDArray[np.floating]

_CELL_PX = 32  # Side of the squares whose medians are fitted.
_FULL = 0.5  # Share of a square that has to be known.
_ALIKE = 10.0  # So many neighbouring squares are off together.
_TURN_DEG, _SHIFT_M = 0.2, 3e-3  # Deviations that are expected.
_SMOOTHED_PX = 2.0  # Sigma, for slopes of a reference that has noise.
_ROUNDS = 10  # Of weighting: a tenth changes no number that is told.
_LEAST_PX = 0.02  # Deviation that squares have at least.
_SLOPE_PX = 1.0  # Between neighbours; more is an edge.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed(CapturedScene):
    """A captured scene whose reference stands as it was fitted."""

    pose: ModelError

    def truth_m(self) -> NDArray[np.float32] | None:
        """As `CapturedScene.truth_m`, moved."""
        depth_m = CapturedScene.truth_m(self)
        return None if depth_m is None else moved(depth_m, self.info, self.pose)


def fitted(off_px: Map, depth_m: NDArray, info: CaptureInfo) -> ModelError | None:
    """Fit the motion of a reference that makes disparity differ from what it tells.

    Args:
        off_px: (h, w) disparity less what the reference tells, NaN where unknown.
        depth_m: (h, w) reference, NaN where unknown.
        info: of the captures.

    Returns:
        Shift and turn; None where too few squares tell of it.

    Source: the motion field of a rigid body (Longuet-Higgins and Prazdny, Proc. R. Soc. Lond. B
    208, 1980), by least squares that are weighted anew (Holland and Welsch, Commun. Stat. A6,
    1977, Cauchy's weights) with a Gaussian prior.
    """
    known = np.isfinite(off_px) & np.isfinite(depth_m) & ~depth_edges(info.disparity_px(depth_m))
    full = cut(known, _CELL_PX).mean(axis=1) >= _FULL
    if np.count_nonzero(full) < 6 * _ALIKE:
        return None
    off, *columns = (
        np.nanmedian(cut(np.where(known, one, np.nan), _CELL_PX)[full], axis=1)
        for one in (off_px, *_changes(depth_m, info))
    )
    matrix = np.stack(columns, axis=1)
    prior = np.diag(np.repeat([np.deg2rad(_TURN_DEG), _SHIFT_M], 3) ** -2.0)
    found = np.zeros(6)
    for _ in range(_ROUNDS):
        left = off - matrix @ found
        spread = max(MAD_TO_SIGMA * float(np.median(np.abs(left))), _LEAST_PX)
        weight = 1 / (1 + (left / (2 * spread)) ** 2) / (_ALIKE * spread**2)
        normal = (matrix * weight[:, None]).T @ matrix + prior
        found = np.linalg.solve(normal, (matrix * weight[:, None]).T @ off)
    rx, ry, rz, x, y, z = (float(one) for one in (*np.rad2deg(found[:3]), *found[3:]))
    return ModelError(turn_deg=(rx, ry, rz), shift_m=(x, y, z))


def moved(depth_m: NDArray[np.float32], info: CaptureInfo, pose: ModelError) -> NDArray[np.float32]:
    """Depth (h, w) of a reference, in the left view, once all of it stands as `pose` says.

    Args:
        depth_m: (h, w), NaN where unknown.
        info: of the captures.
        pose: shift and turn; some pixels in the image at most.
    """
    turn, shift = np.deg2rad(pose.turn_deg), np.asarray(pose.shift_m)
    flow_x, flow_y, further = _flow(_whole(depth_m), info, turn, shift)
    here = np.indices(depth_m.shape)[::-1].astype(np.float32)  # Columns, rows.
    source = here
    for _ in range(2):
        moves = [_remapped(one, source, cv2.INTER_NEAREST) for one in (flow_x, flow_y)]
        source = here - np.stack(moves)
    disparity = info.disparity_px(depth_m)
    nearest = _remapped(disparity, source, cv2.INTER_NEAREST)
    between = _remapped(disparity, source, cv2.INTER_LINEAR)
    there = np.where(np.abs(between - nearest) < _SLOPE_PX, between, nearest)
    deeper = _remapped(further, source, cv2.INTER_NEAREST)
    return np.asarray(info.focal_baseline_px_m / there + deeper, np.float32)


def _changes(depth_m: NDArray, info: CaptureInfo) -> Iterator[Map]:
    """Disparity (h, w) that each of the six small motions adds, at pixels of the left view."""
    whole = _whole(depth_m)
    disparity = np.asarray(cv2.GaussianBlur(info.disparity_px(whole), (0, 0), _SMOOTHED_PX))
    down, along = np.gradient(disparity)
    for turn, shift in np.eye(6).reshape(6, 2, 3):
        flow_x, flow_y, further = _flow(whole, info, turn, shift)
        yield -along * flow_x - down * flow_y - disparity * further / whole


def _remapped(image: Map, places: NDArray[np.float32], between: int) -> NDArray[np.float32]:
    """An image at places of it (columns, rows); beyond its border nothing is known."""
    found = cv2.remap(
        np.asarray(image, np.float32),
        places[0],
        places[1],
        between,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(float("nan"),) * 4,
    )
    return np.asarray(found, np.float32)


def _flow(whole: Map, info: CaptureInfo, turn: Map, shift: Map) -> tuple[Map, Map, Map]:
    """Motion in the image [px] of the points that pixels show, and in depth [m]."""
    y, x = np.indices(whole.shape)
    ray_x, ray_y = (x - info.cx_px) / info.fx_px, (y - info.cy_px) / info.fy_px
    points = np.stack([ray_x * whole, ray_y * whole, whole], axis=-1)
    moves = np.cross(turn, points) + shift
    further = moves[..., 2]
    flow_x = info.fx_px * (moves[..., 0] - ray_x * further) / whole
    flow_y = info.fy_px * (moves[..., 1] - ray_y * further) / whole
    return flow_x, flow_y, further


def _whole(depth_m: NDArray) -> Map:
    """Depth with that of the nearest known pixel where it is unknown."""
    return filled(depth_m, np.isfinite(depth_m)).astype(np.float64)
