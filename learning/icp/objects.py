"""Objects of a scene, cut from its reference depth: their poses are known because they stay."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Mask
from starling.learning.icp import cloud, segments
from starling.learning.icp.cloud import Cloud, Points, Surface
from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo

LEFT_BAND_PX = 100  # Columns in which a pair has no depth; no object may reach into them.
FEWEST_PX = 1500  # An object of fewer pixels says little.
SMALLEST_M, LARGEST_M = 0.1, 0.6  # Longest side of an object.
LEAST_INFORMATION = 0.01  # See `information`; scanned balls and bottles have some 0.001.
_RIM_PX = 2  # A scanner's depth edges are unsure by this much [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Piece:
    """An object as far as the left imager sees it, in that imager's frame: its pose is identity."""

    name: str
    scene: str
    room: str
    pixels: Mask  # (h, w) in the left view.
    surface: Cloud
    centre_m: Points  # (3,) mean of its points: the object's origin.
    side_m: float  # Longest side of the box along its principal axes.
    information: float

    @property
    def observable(self) -> bool:
        """Whether its shape tells its pose."""
        return self.information >= LEAST_INFORMATION


def information(surface: Cloud) -> float:
    """Tell how well point-to-plane alignment determines all six degrees of freedom of a surface.

    The smallest eigenvalue of the mean of j j', j = (p x n, n), with points p from their mean in
    units of their root mean square distance (N. Gelfand et al., Geometrically Stable Sampling for
    the ICP Algorithm, 3DIM 2003). 0 where the surface can slide along itself, as planes,
    cylinders and balls can; 2/15 for a cube.
    """
    if len(surface) < 6:
        return 0.0
    arm = surface.point_m - surface.point_m.mean(axis=0)
    length = np.sqrt((arm**2).sum(axis=1).mean())
    row = np.hstack([np.cross(arm / length, surface.normal), surface.normal])
    return float(max(np.linalg.eigvalsh(row.T @ row / len(row))[0], 0.0))


def by_label(
    depth_m: Image,
    label: NDArray[np.integer],
    info: CaptureInfo,
    *,
    scene: str,
    room: str,
) -> list[Piece]:
    """Objects of a labelled scene that are as large, and as sure of their pose, as `in_room`.

    Args:
        depth_m: (h, w) reference depth z [m], NaN where unknown.
        label: (h, w) number of the object that each pixel shows; 0 shows none.
        info: intrinsics and baseline.
        scene: for the pieces' names.
        room: likewise.

    Raises:
        InputError: if the label is of another shape than the depth.
    """
    if label.shape != depth_m.shape:
        raise errors.refuse(
            "label", f"must be of shape {depth_m.shape}", label.shape, "Take both from one view."
        )
    return _of_size(cloud.surface(depth_m, info), label, scene, room)


def in_room(depth_m: Image, info: CaptureInfo, *, scene: str, room: str) -> list[Piece]:
    """Find objects in a scanned room.

    An object is a convex piece of the surface (`segments`), 0.1 to 0.6 m long, right of the left
    band, of 1500 pixels or more, whose shape tells its pose (`information` of 0.01 or more).

    Args:
        depth_m: (h, w) reference depth z [m] of a scanner, NaN where unknown.
        info: intrinsics and baseline.
        scene: for the pieces' names.
        room: likewise.
    """
    shown = cloud.surface(depth_m, info)
    label = segments.convex_pieces(shown, info.disparity_px(depth_m), fewest_px=FEWEST_PX)
    label[:, :LEFT_BAND_PX] = 0
    return _of_size(shown, label, scene, room)


def _of_size(shown: Surface, label: NDArray[np.integer], scene: str, room: str) -> list[Piece]:
    found = []
    for number in np.unique(label[label > 0]).tolist():
        pixels = label == number
        if np.count_nonzero(pixels) < FEWEST_PX:
            continue
        piece = _piece(shown, pixels, str(number), scene, room)
        if piece is None or not SMALLEST_M <= piece.side_m <= LARGEST_M:
            continue
        if piece.observable:
            found.append(piece)
    return found


def _piece(shown: Surface, pixels: Mask, name: str, scene: str, room: str) -> Piece | None:
    known = pixels & shown.known
    surface = shown.cloud(known)
    if len(surface) < 4:
        return None
    centre = surface.point_m.mean(axis=0)
    arm = surface.point_m - centre
    _, axes = np.linalg.eigh(arm.T @ arm)
    # Bent normals at an unsure rim make a flat sheet look as if it had a shape.
    side = 2 * _RIM_PX + 1
    inner = cv2.erode(pixels.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0)
    core = inner[known].astype(bool)
    return Piece(
        name=name,
        scene=scene,
        room=room,
        pixels=known,
        surface=surface,
        centre_m=centre,
        side_m=float(np.ptp(arm @ axes, axis=0).max()),
        information=information(Cloud(point_m=surface.point_m[core], normal=surface.normal[core])),
    )
