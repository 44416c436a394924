"""Rectification of a pair by given intrinsics, distortion and pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.recordings.recording import ImagerCalibration
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

# Models of ROS with OpenCV's coefficients; the second and third are those of librealsense.
_MODELS = ("plumb_bob", "rational_polynomial", "Brown Conrady", "")
_SAME_PX = 0.01  # Rectified cameras of a pair agree in focal length and principal row [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rectification:
    """Maps of both images to the rectified pair, and the rectified pair's geometry."""

    camera: Pinhole
    baseline_m: float
    left_map: tuple[NDArray[Any], NDArray[Any]]
    right_map: tuple[NDArray[Any], NDArray[Any]]

    def left(self, image: NDArray[Any]) -> NDArray[Any]:
        """Rectify a left image."""
        return cv2.remap(image, *self.left_map, cv2.INTER_LINEAR)

    def right(self, image: NDArray[Any]) -> NDArray[Any]:
        """Rectify a right image."""
        return cv2.remap(image, *self.right_map, cv2.INTER_LINEAR)


def rectification(
    lenses: tuple[ImagerCalibration, ImagerCalibration],
    right_from_left: Pose | None,
    size: tuple[int, int],
) -> Rectification:
    """Find the maps that rectify a pair.

    Args:
        lenses: calibrations of the left and right imager.
        right_from_left: pose of the unrectified imagers [m]; None uses R and P of the lenses.
        size: width and height of the images [px]; lenses of other sizes are scaled.

    Raises:
        InputError: if the distortion model is unknown, or the pose is unknown and R and P are
            missing. Also if R and P are of no rectified pair.
    """
    for lens in lenses:
        if lens.model not in _MODELS:
            listed = ", ".join(name for name in _MODELS if name)
            rule, advice = f"must be one of {listed}", "Rectify the images before."
            raise errors.refuse("distortion model", rule, lens.model, advice)
        if lens.width * size[1] != lens.height * size[0]:
            rule = f"must be of images as wide and high as {size[0]}x{size[1]}, or scaled alike"
            got = f"{lens.width}x{lens.height}"
            raise errors.refuse("calibration", rule, got, "Give that of this image size.")
    left, right = lenses
    turns, projections = _stated(left, right, size)
    if projections is None:
        if right_from_left is None:
            rule = "must give the right imager's place"
            advice = "Give camera_info with R and P of both imagers: --calibration LEFT RIGHT."
            raise errors.refuse("calibration", rule, "none", advice)
        turns, projections = _computed(left, right, right_from_left, size)
    first, second = projections
    if abs(first[0, 0] - second[0, 0]) > _SAME_PX or abs(first[1, 2] - second[1, 2]) > _SAME_PX:
        got = f"fx {first[0, 0]:g} and {second[0, 0]:g}, cy {first[1, 2]:g} and {second[1, 2]:g}"
        rule = "must have P of one rectified pair"
        raise errors.refuse("calibration", rule, got, "Calibrate left and right together.")
    maps = [
        cv2.initUndistortRectifyMap(
            _scaled(lens.matrix, lens, size), lens.distortion, turn, p[:, :3], size, cv2.CV_32FC1
        )
        for lens, turn, p in zip(lenses, turns, projections, strict=True)
    ]
    return Rectification(
        camera=Pinhole.from_matrix(first, size),
        baseline_m=float(-second[0, 3] / second[0, 0]),
        left_map=(maps[0][0], maps[0][1]),
        right_map=(maps[1][0], maps[1][1]),
    )


def _stated(
    left: ImagerCalibration, right: ImagerCalibration, size: tuple[int, int]
) -> tuple[Any, Any]:
    """Return R and P of both lenses; None without them."""
    both = (left, right)
    whole = all(
        lens.projection is not None and lens.projection.any() and lens.rotation is not None
        for lens in both
    )
    if not whole or right.projection is None or not right.projection[0, 3]:
        return None, None
    turns = [lens.rotation if np.any(lens.rotation) else np.eye(3) for lens in both]
    return turns, [_scaled(lens.projection, lens, size) for lens in both]


def _computed(
    left: ImagerCalibration, right: ImagerCalibration, right_from_left: Pose, size: tuple[int, int]
) -> tuple[Any, Any]:
    """Return R and P by OpenCV; both images have one principal point."""
    matrices = [_scaled(lens.matrix, lens, size) for lens in (left, right)]
    first, second, p_left, p_right, *_ = cv2.stereoRectify(
        matrices[0],
        left.distortion,
        matrices[1],
        right.distortion,
        size,
        right_from_left[:3, :3],
        right_from_left[:3, 3:],  # A column: OpenCV 5 refuses a plain vector.
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    return (first, second), (p_left, p_right)


def _scaled(matrix: Any, lens: ImagerCalibration, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return K or P [px] for another image size; integer coordinates are pixel centres."""
    scale = size[0] / lens.width
    result = np.array(matrix, np.float64)
    result[:2] *= scale
    result[:2, 2] += 0.5 * scale - 0.5
    return result
