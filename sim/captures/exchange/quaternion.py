"""Rotations as unit quaternions (x, y, z, w), as in trajectory files."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from starling.sim.geometry.frames import Pose


def from_pose(pose: Pose) -> tuple[float, float, float, float]:
    """Return the quaternion of a rigid pose's rotation, with w >= 0."""
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def pose(place_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """Return the rigid pose of a position (3,) [m] and a quaternion (4,) of any nonzero length."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = place_m
    return matrix
