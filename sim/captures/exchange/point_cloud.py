"""Export to point clouds with colours, PLY or PCD: one binary file for each frame.

    SCENE/0.ply     x y z [m] in the left imager's frame; red green blue

Colours come from `rgb.png`, where the colour camera sees the point, else from `ir_left.png`. A
colour camera that is occluded shows the surface in front.

Sources: PLY by G. Turk, 1994; PCD 0.7 of the Point Cloud Library.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.arrays import Image
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.console.output import Folder
from starling.sim.geometry.pinhole import Pinhole

Format = Literal["ply", "pcd"]
_LIGHT = 200  # Grey of points without an image.


def export(scenes: Sequence[CapturedScene], folder: Folder, form: Format) -> int:
    """Write the points of every frame.

    Args:
        scenes: the frames need depth.
        folder: output folder.
        form: format of the files.

    Returns:
        Number of written files.

    Raises:
        InputError: if a frame has no depth.
    """
    count = 0
    for scene in scenes:
        for number in scene.frames:
            points, colours = coloured(scene, scene.frame(number))
            write = {"ply": _ply, "pcd": _pcd}[form]
            folder.write(f"{scene.name}/{number}.{form}", write(points, colours))
            count += 1
    return count


def coloured(scene: CapturedScene, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return the points (n, 3) [m] of a frame, and their colours (n, 3) red, green, blue.

    Raises:
        InputError: if the frame has no depth.
    """
    if frame.depth_m is None:
        name = f"frame {frame.number} of {scene.name}"
        raise refuse(name, "must have depth", "none", "A point cloud needs depth.")
    points, rows, columns = points_of(frame.depth_m, Pinhole.from_camera(scene.info))
    colours = _grey(frame.ir_left, rows, columns)
    picture = scene.colour(frame.number)
    if picture is not None:
        _paint(colours, points, picture, scene.info)
    return points, colours


def points_of(
    depth_m: Image, camera: Pinhole
) -> tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.intp]]:
    """Return the points (n, 3) [m] of a depth image, and their rows and columns."""
    rows, columns = np.nonzero(np.isfinite(depth_m))
    z = depth_m[rows, columns].astype(np.float64)
    x = (columns - camera.cx_px) / camera.fx_px * z
    y = (rows - camera.cy_px) / camera.fy_px * z
    return np.stack([x, y, z], axis=1).astype(np.float32), rows, columns


def _grey(
    infrared: GreyImage | None, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> NDArray[np.uint8]:
    """Return the infrared image as colours (n, 3) of the points."""
    if infrared is None:
        return np.full((len(rows), 3), _LIGHT, np.uint8)
    level = infrared[rows, columns].astype(np.float64)
    largest = max(float(np.iinfo(infrared.dtype).max), 1.0)
    return np.repeat((level / largest * 255).astype(np.uint8)[:, None], 3, axis=1)


def _paint(
    colours: NDArray[np.uint8],
    points: NDArray[np.float32],
    picture: NDArray[np.uint8],
    info: CaptureInfo,
) -> None:
    """Overwrite the colours of points that the colour camera has in its image."""
    if info.colour is None or info.colour_from_left is None:
        return
    pose, camera = np.array(info.colour_from_left), info.colour
    x, y, z = (points.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]).T
    ahead = np.maximum(z, 1e-6)
    column = np.rint(x / ahead * camera.fx_px + camera.cx_px).astype(np.int64)
    row = np.rint(y / ahead * camera.fy_px + camera.cy_px).astype(np.int64)
    height, width = picture.shape[:2]
    inside = (z > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    colours[inside] = picture[row[inside], column[inside]]


def _ply(points: NDArray[np.float32], colours: NDArray[np.uint8]) -> bytes:
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    table = np.zeros(len(points), [*fields, ("r", "u1"), ("g", "u1"), ("b", "u1")])
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    for channel, name in enumerate("rgb"):
        table[name] = colours[:, channel]
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            f"element vertex {len(points)}",
            *(f"property float {axis}" for axis in "xyz"),
            *(f"property uchar {name}" for name in ("red", "green", "blue")),
            "end_header\n",
        ]
    )
    return header.encode() + table.tobytes()


def _pcd(points: NDArray[np.float32], colours: NDArray[np.uint8]) -> bytes:
    """Return PCD; a colour is packed into the bytes of one float."""
    table = np.zeros(len(points), [("xyz", "<f4", 3), ("rgb", "<u4")])
    table["xyz"] = points
    red, green, blue = (colours[:, channel].astype(np.uint32) for channel in range(3))
    table["rgb"] = (red << 16) | (green << 8) | blue
    header = "\n".join(
        [
            "# .PCD v0.7 - Point Cloud Data file format",
            "VERSION 0.7",
            "FIELDS x y z rgb",
            "SIZE 4 4 4 4",
            "TYPE F F F F",
            "COUNT 1 1 1 1",
            f"WIDTH {len(points)}",
            "HEIGHT 1",
            "VIEWPOINT 0 0 0 1 0 0 0",
            f"POINTS {len(points)}",
            "DATA binary\n",
        ]
    )
    return header.encode() + table.tobytes()
