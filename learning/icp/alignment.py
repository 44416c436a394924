"""Disturbance of an object's pose and its estimation by iterative closest points (ICP)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starling.learning.data.example import Image, Mask
from starling.learning.icp.cloud import Cloud, Points, Surface
from starling.learning.icp.objects import Piece
from starling.patterns import errors

MARGIN_M = 0.1  # Margin of scene points around the object [m].
MODEL_POINTS = 1000  # Points drawn from an object's surface.
SCENE_POINTS = 5000  # Points of the reference around an object; fewer with holes.
# OpenCV's outlier rejection removes points at every step and never restores them. With more levels
# or steps, the coarsest level runs out of points and some poses diverge.
_STEPS, _TOLERANCE, _REJECTION, _LEVELS = 50, 1e-3, 2.5, 2


@dataclass(frozen=True, kw_only=True, slots=True)
class Disturbance:
    """Random error of an object's initial pose.

    Directions and axes are uniform over the sphere, lengths and angles from zero to these limits.
    The paper states "slightly" without numbers.

    Raises:
        InputError: if a limit is negative, the length above 1 m or the angle above 180 degrees.
    """

    most_m: float = 0.03
    most_deg: float = 15.0

    def __post_init__(self) -> None:
        errors.in_interval("most_m", self.most_m, 0.0, 1.0, "Give a length [m].")
        errors.in_interval("most_deg", self.most_deg, 0.0, 180.0, "Give an angle [deg].")

    def draw(self, centre_m: Points, draw: np.random.Generator) -> Points:
        """Draw a rigid motion (4, 4): a rotation about a centre (3,), then a translation."""
        shift, axis = (value / np.linalg.norm(value) for value in draw.standard_normal((2, 3)))
        length, angle = draw.random(2) * (self.most_m, math.radians(self.most_deg))
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
        motion[:3, 3] = centre_m - motion[:3, :3] @ centre_m + length * shift
        return motion


@dataclass(frozen=True, kw_only=True, slots=True)
class PoseError:
    """Error of an estimated pose."""

    position_m: float  # Distance of the object's centre from its true position [m].
    rotation: float  # 1 - |<q1, q2>| of the unit quaternions: 1 - cos(angle / 2).


def scene_pixels(piece: Piece, reference: Surface, draw: np.random.Generator) -> Mask:
    """Draw the pixels around an object from which scene points are made.

    They are drawn in the reference, so that all depth images of a view are compared at the same
    pixels. Equal images then give equal clouds.

    Args:
        piece: the object.
        reference: the scene without holes.
        draw: random generator.

    Returns:
        (h, w), about `SCENE_POINTS` pixels within the object's radius and margin.
    """
    reach = np.linalg.norm(piece.surface.point_m - piece.centre_m, axis=1).max() + MARGIN_M
    away = np.linalg.norm(reference.point_m - piece.centre_m, axis=-1)
    near = away <= reach  # False for NaN.
    share = SCENE_POINTS / max(np.count_nonzero(near), 1)
    return near & (draw.random(near.shape) < share)


def model_points(piece: Piece, draw: np.random.Generator) -> Cloud:
    """Return points of an object in random order.

    OpenCV's coarse levels take every k-th point, and its outlier rejection shortens the list from
    its end. In image order, this would favour an object's upper side.
    """
    order = draw.permutation(len(piece.surface))[:MODEL_POINTS]
    return Cloud(point_m=piece.surface.point_m[order], normal=piece.surface.normal[order])


def visible_share(piece: Piece, depth_m: Image) -> float:
    """Share of an object's pixels that have depth in another depth image (h, w) of the view."""
    return float(np.isfinite(depth_m[piece.pixels]).mean())


def register(model: Cloud, scene: Cloud) -> NDArray[np.float64]:
    """Align a model with a scene by OpenCV's ICP, point to plane, coarse to fine.

    Args:
        model: in the scene's frame at its initial pose.
        scene: with normals.

    Returns:
        `scene_from_model` (4, 4): the correction of the initial pose.

    Source: cv2.ppf_match_3d.ICP (T. Birdal); picky ICP of Zinsser, Schmidt and Niemann, ICIP 2003,
    with the linear step of K.-L. Low, University of North Carolina TR04-004, 2004.
    """
    icp = cv2.ppf_match_3d.ICP(_STEPS, _TOLERANCE, _REJECTION, _LEVELS)
    _, _, scene_from_model = icp.registerModelToScene(model.rows(), scene.rows())
    return np.asarray(scene_from_model, np.float64)


def pose_error(estimate: Points, centre_m: Points) -> PoseError:
    """Error of an estimated motion (4, 4) of an object that has not moved."""
    w = Rotation.from_matrix(estimate[:3, :3]).as_quat()[3]
    moved_m = estimate[:3, :3] @ centre_m + estimate[:3, 3]
    return PoseError(
        position_m=float(np.linalg.norm(moved_m - centre_m)), rotation=float(1 - min(abs(w), 1.0))
    )
