"""Frames and poses. All code uses OpenCV's axes; only this module converts other axes.

OpenCV camera frame: x right, y down, z forward, integer coordinate = pixel centre. Mitsuba's
camera looks along +z with +x to the left and +y up, and its pixel centres lie at +0.5. OpenGL's
camera looks along -z with +x to the right and +y up. A body of ROS has x forward, y left, z up
(REP 103).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import arrays

Pose = NDArray[np.float64]  # (4, 4) rigid transform, named `to_from`: x_to = to_from @ x_from.

_MITSUBA_FROM_OPENCV = np.diag([-1.0, -1.0, 1.0, 1.0])
_OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_ROS_FROM_OPENCV = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_ROUNDING = 1e-6  # Default tolerance of a rotation's orthonormality.
SIMULATOR_ROUNDING = 1e-4  # Simulators compute poses in single precision.
FARTHEST_M = 1e7  # Limit of the shift; world coordinates of maps are smaller [m].


def refuse_not_rigid(
    name: str,
    pose: Pose,
    *,
    rounding: float = _ROUNDING,
    axes: str = "x is right, y down and z forward.",
) -> None:
    """Refuse a (4, 4) matrix that is not `[R t; 0 0 0 1]` with R orthonormal of determinant +1.

    Args:
        name: name of the pose in error messages.
        pose: (4, 4) matrix from a file or a caller.
        rounding: tolerance of the orthonormality.
        axes: advice for a mirrored pose.

    Raises:
        InputError: if it is scaled, mirrored, singular, not finite, or shifted beyond 1e7 m.
    """
    pose = pose.astype(np.float64)
    rotation = pose[:3, :3]
    # No entry of a rotation exceeds 1. The squares of larger entries may overflow.
    bounded = bool(np.abs(rotation).max() <= 1 + rounding)
    if not bounded or np.abs(rotation @ rotation.T - np.eye(3)).max() > rounding:
        rule = f"must be rigid, its rotation orthonormal to {rounding:g}"
        raise errors.refuse(name, rule, pose.tolist(), "Give all digits, and metres as unit.")
    if np.linalg.det(rotation) < 0:
        raise errors.refuse(name, "must turn, not mirror", pose.tolist(), axes)
    for value in pose[:3, 3].tolist():
        errors.in_interval(f"shift of {name}", value, -FARTHEST_M, FARTHEST_M)
    if pose[3].tolist() != [0, 0, 0, 1]:
        raise errors.refuse(
            f"last row of {name}", "must be 0 0 0 1", pose[3].tolist(), "Is it transposed?"
        )


def rotation(rotation_deg: tuple[float, float, float]) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) of a rotation vector [deg] (Rodrigues' formula)."""
    vector = np.deg2rad(np.asarray(rotation_deg, np.float64))
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pose(
    position_m: tuple[float, float, float], rotation_deg: tuple[float, float, float] = (0, 0, 0)
) -> Pose:
    """Pose `frame_from_part` (4, 4) of a part at `position_m`, turned by `rotation_deg`."""
    frame_from_part = np.eye(4)
    frame_from_part[:3, :3] = rotation(rotation_deg)
    frame_from_part[:3, 3] = position_m
    return frame_from_part


def right_of(world_from_left: Pose, baseline_m: float) -> Pose:
    """Pose of the right imager of a rectified pair."""
    return world_from_left @ pose((baseline_m, 0.0, 0.0))


def look_at(
    eye_m: tuple[float, float, float],
    target_m: tuple[float, float, float],
    up: tuple[float, float, float],
) -> Pose:
    """Pose `world_from_camera` of a camera at `eye_m` that looks at `target_m`.

    Raises:
        InputError: if eye and target coincide or `up` is parallel to the view.
    """
    forward = np.subtract(target_m, eye_m).astype(np.float64)
    if np.linalg.norm(forward) < 1e-9:
        raise errors.refuse("eye", "must differ from target", list(eye_m), "Move one of them.")
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-6:
        raise errors.refuse("up", "must not be parallel to the view", list(up), "Turn it.")
    right /= np.linalg.norm(right)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    world_from_camera[:3, 3] = eye_m
    return world_from_camera


def mitsuba_to_world(world_from_camera: Pose) -> Pose:
    """Mitsuba's `to_world` of a sensor or projector from its OpenCV pose (4, 4)."""
    return world_from_camera @ _MITSUBA_FROM_OPENCV


def opencv_from_mitsuba(to_world: Pose) -> Pose:
    """OpenCV pose `world_from_camera` from Mitsuba's `to_world`; inverse of `mitsuba_to_world`."""
    return to_world @ _MITSUBA_FROM_OPENCV


def from_opengl(pose: Any) -> Pose:
    """OpenCV pose `world_from_camera` (4, 4) from OpenGL's camera-to-world; its own inverse.

    Args:
        pose: (4, 4) of a camera with x right, y up, z backward.

    Raises:
        InputError: if it is no rigid transform.
    """
    return _checked(pose, "x is right, y up and z backward.") @ _OPENGL_FROM_OPENCV


def from_ros(pose: Any) -> Pose:
    """OpenCV pose `world_from_camera` (4, 4) from the pose of a body in ROS.

    Args:
        pose: (4, 4) of a body with x forward, y left, z up, such as `camera_link`.

    Raises:
        InputError: if it is no rigid transform.
    """
    return _checked(pose, "x is forward, y left and z up.") @ _ROS_FROM_OPENCV


def _checked(pose: Any, axes: str) -> Pose:
    matrix = arrays.numbers("pose", pose).astype(np.float64)
    if matrix.shape != (4, 4):
        advice = "Give one camera-to-world matrix."
        raise errors.refuse("pose", "must be (4, 4)", matrix.shape, advice)
    refuse_not_rigid("pose", matrix, rounding=SIMULATOR_ROUNDING, axes=axes)
    return matrix


def principal_point_offset(
    cx_px: float, cy_px: float, width: int, height: int
) -> tuple[float, float]:
    """Mitsuba's relative `principal_point_offset_x`, `_y` of OpenCV's principal point [px]."""
    return 0.5 - (cx_px + 0.5) / width, 0.5 - (cy_px + 0.5) / height


def to_quaternion(pose: Pose) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a rigid pose's rotation, with w >= 0."""
    from scipy.spatial.transform import Rotation  # Heavy, like all of scipy: not at import.

    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def from_quaternion(place_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """Rigid pose of a position (3,) [m] and a quaternion (4,) of any nonzero length."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = place_m
    return matrix
