"""Objects of a scene, segmented in its reference depth. They are static, with known poses.

A scene is divided at depth steps and at concave creases. Where two convex bodies touch, their
surface is concave (S. C. Stein et al., Object Partitioning Using Local Convexity, CVPR 2014).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.learning.data.example import Image, Mask
from starling.learning.icp import cloud
from starling.learning.icp.cloud import Cloud, Points, Surface
from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo

_CREASE_PX = 5  # Distance of the pixels on both sides of a crease [px].
_CREASE_COS = float(np.cos(np.radians(20)))  # Surfaces that bend less are smooth.
_REGROWN_PX = 8.0  # Distance by which pieces grow back into steps and creases [px].


def convex_pieces(surface: Surface, disparity_px: Image, *, fewest_px: int) -> NDArray[np.int32]:
    """Label the smooth or convex pieces of a surface.

    Args:
        surface: surface of a depth image with little noise (a scanner's).
        disparity_px: (h, w) disparity of the same image, NaN where unknown.
        fewest_px: least area of a piece [px].

    Returns:
        (h, w) labels 1, 2, ... in the order of each piece's first pixel; 0 elsewhere.
    """
    cut = ~surface.known
    for axis in (0, 1):
        cut |= _step(disparity_px, axis) | _crease(surface, axis)
    # Erode by one pixel, so that pieces do not connect through gaps in the cut.
    free = cv2.erode((~cut).astype(np.uint8), np.ones((3, 3), np.uint8))
    _, label, box, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    large = box[:, cv2.CC_STAT_AREA] >= fewest_px
    large[0] = False
    number = np.where(large, np.cumsum(large), 0).astype(np.int32)
    return _regrown(number[label.astype(np.intp)], disparity_px)


def _step(disparity: Image, axis: int) -> Mask:
    rise = np.diff(disparity, axis=axis)
    before, after = ((1, 0), (0, 1))
    pads = [[(0, 0), (0, 0)], [(0, 0), (0, 0)]]
    pads[0][axis], pads[1][axis] = before, after
    step = ~cloud.same_surface(rise, 1.0)
    return np.pad(step, pads[0]) | np.pad(step, pads[1])


def _crease(surface: Surface, axis: int) -> Mask:
    """Return pixels (h, w) between two sides whose normals lean towards each other."""
    point, normal = surface.point_m, surface.normal
    size = point.shape[axis] - 2 * _CREASE_PX
    crease = np.zeros(point.shape[:2], bool)
    if size <= 0:
        return crease
    first, second = (
        tuple(slice(start, start + size) if a == axis else slice(None) for a in (0, 1))
        for start in (0, 2 * _CREASE_PX)
    )
    inside = tuple(
        slice(_CREASE_PX, _CREASE_PX + size) if a == axis else slice(None) for a in (0, 1)
    )
    bent = (normal[first] * normal[second]).sum(axis=-1) < _CREASE_COS
    offset, turn = point[second] - point[first], normal[second] - normal[first]
    crease[inside] = bent & ((offset * turn).sum(axis=-1) < 0)
    return crease


def _regrown(label: NDArray[np.int32], disparity: Image) -> NDArray[np.int32]:
    """Assign unlabelled pixels near a piece to it if they continue its surface."""
    away, nearest = cast(
        tuple[NDArray[np.float64], NDArray[np.int32]],
        ndimage.distance_transform_edt(label == 0, return_indices=True),
    )
    source = tuple(nearest)
    joins = cloud.same_surface(disparity - disparity[source], away) & (away <= _REGROWN_PX)
    return np.where(joins, label[source], 0).astype(np.int32)


LEFT_BAND_PX = 100  # Columns without stereo matches; objects must not extend into them.
FEWEST_PX = 1500  # Least area of an object [px].
SMALLEST_M, LARGEST_M = 0.1, 0.6  # Range of an object's longest side [m].
LEAST_INFORMATION = 0.01  # See `information`; scanned balls and bottles have about 0.001.
_RIM_PX = 2  # Uncertainty of a scanner's depth edges [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Piece:
    """The visible part of an object in the left imager's frame; its pose is the identity."""

    name: str
    scene: str
    room: str
    pixels: Mask  # (h, w) in the left view.
    surface: Cloud
    centre_m: Points  # (3,) mean of its points, the object's origin.
    side_m: float  # Longest side of the box along its principal axes.
    information: float

    @property
    def observable(self) -> bool:
        """Whether the shape determines the pose."""
        return self.information >= LEAST_INFORMATION


def information(surface: Cloud) -> float:
    """Measure how well point-to-plane alignment determines the six degrees of freedom of a surface.

    This is the smallest eigenvalue of the mean of j j', j = (p x n, n). Points p are relative to
    their mean, in units of their root mean square distance (N. Gelfand et al., Geometrically Stable
    Sampling for the ICP Algorithm, 3DIM 2003). It is 0 for surfaces that can slide along
    themselves, such as planes, cylinders and balls, and 2/15 for a cube.
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
    """Return the objects of a labelled scene, with the same limits of size and shape as `in_room`.

    Args:
        depth_m: (h, w) reference depth z [m], NaN where unknown.
        label: (h, w) number of each pixel's object; 0 is none.
        info: intrinsics and baseline.
        scene: name of the scene.
        room: name of the room.

    Raises:
        InputError: if label and depth differ in shape.
    """
    if label.shape != depth_m.shape:
        raise errors.refuse(
            "label", f"must be of shape {depth_m.shape}", label.shape, "Give both of one view."
        )
    return _of_size(cloud.surface(depth_m, info), label, scene, room)


def in_room(depth_m: Image, info: CaptureInfo, *, scene: str, room: str) -> list[Piece]:
    """Find objects in a scanned room.

    An object is a convex piece of the surface (`segments`), 0.1 to 0.6 m long. It lies right of
    the left band and has 1500 pixels or more. Its shape determines its pose: `information` is 0.01
    or more.

    Args:
        depth_m: (h, w) reference depth z [m] of a scanner, NaN where unknown.
        info: intrinsics and baseline.
        scene: name of the scene.
        room: name of the room.
    """
    shown = cloud.surface(depth_m, info)
    label = convex_pieces(shown, info.disparity_px(depth_m), fewest_px=FEWEST_PX)
    label[:, :LEFT_BAND_PX] = 0
    return _of_size(shown, label, scene, room)


def _of_size(shown: Surface, label: NDArray[np.integer], scene: str, room: str) -> list[Piece]:
    pieces = []
    for number in np.unique(label[label > 0]).tolist():
        pixels = label == number
        if np.count_nonzero(pixels) < FEWEST_PX:
            continue
        piece = _piece(shown, pixels, str(number), scene, room)
        if piece is None or not SMALLEST_M <= piece.side_m <= LARGEST_M:
            continue
        if piece.observable:
            pieces.append(piece)
    return pieces


def _piece(shown: Surface, pixels: Mask, name: str, scene: str, room: str) -> Piece | None:
    known = pixels & shown.known
    surface = shown.cloud(known)
    if len(surface) < 4:
        return None
    centre = surface.point_m.mean(axis=0)
    arm = surface.point_m - centre
    _, axes = np.linalg.eigh(arm.T @ arm)
    # Wrong normals at the uncertain rim would give a flat sheet an apparent shape.
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
