"""Rotations as unit quaternions (x, y, z, w), as trajectories are written."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from starling.sim.geometry.frames import Pose


def of(pose: Pose) -> tuple[float, float, float, float]:
    """Quaternion of a rigid pose's rotation, w >= 0."""
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def pose(place_m: np.ndarray, quaternion: np.ndarray) -> Pose:
    """Rigid pose of a place (3,) and a quaternion (4,) of any length but 0."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    found[:3, 3] = place_m
    return found
