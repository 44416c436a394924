"""The seed paper's case study: are alignment errors in a method's depth like those in real depth?

Objects' poses are disturbed and estimated by iterative closest points (ICP). C. Sweeney, G. Izatt
and R. Tedrake, A Supervised Approach to Predicting Noise in Depth Images, ICRA 2019, section
IV-B.2 and Table I.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starling.learning.data.example import Image, Mask
from starling.learning.icp import cloud
from starling.learning.icp.cloud import Cloud, Points, Surface
from starling.learning.icp.objects import Piece
from starling.patterns import errors
from starling.patterns.errors import whole_number
from starling.sim.captures.info import CaptureInfo
from starling.sim.randomness import generator

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


REAL = "real"  # The device's own depth image, the reference of the comparison.
LEAST_VISIBLE = 0.1  # Objects with a smaller share of depth are hidden.
FEWEST_POINTS = 200  # Objects with fewer scene points around them are hidden.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Outcome:
    """Pose errors in one method's depth images, (objects, trials); NaN for hidden objects."""

    objects: tuple[str, ...]  # `scene/name`, in the same order for all methods.
    position_m: NDArray[np.float64]
    rotation: NDArray[np.float64]  # 1 - |<q1, q2>|.

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which objects are visible (objects,)."""
        return np.asarray(np.isfinite(self.position_m).all(axis=1))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Task:
    """The alignment task of one object, common to all methods."""

    pixels: Mask
    model: Cloud
    motions: tuple[Points, ...]


def _pose(
    piece: Piece, reference: Surface, disturbance: Disturbance, trials: int, seed: int
) -> _Task:
    draw = generator(seed, 0, "learning", f"icp {piece.scene}/{piece.name}")
    return _Task(
        pixels=scene_pixels(piece, reference, draw),
        model=model_points(piece, draw),
        motions=tuple(disturbance.draw(piece.centre_m, draw) for _ in range(trials)),
    )


def align(
    pieces: Sequence[Piece],
    reference_m: Image,
    depth_m: Mapping[str, Image],
    info: CaptureInfo,
    *,
    disturbance: Disturbance,
    trials: int,
    seed: int,
) -> dict[str, Outcome]:
    """Disturb every object of a scene and align it in every method's depth image.

    All methods have the same initial poses at the same pixels, so that differences come from depth.

    Args:
        pieces: objects of one scene, at least one.
        reference_m: (h, w) z [m] in which the objects were segmented.
        depth_m: by method, (h, w) z [m], NaN where there is no depth; includes `REAL`.
        info: intrinsics and baseline.
        disturbance: error of the initial poses.
        trials: initial poses per object, 2 or more.
        seed: seed of the initial poses.

    Raises:
        InputError: if there is no object, no real depth, an image without depth or of another
            shape, or fewer than two trials.
    """
    whole_number("trials", trials, 2, 10**6)
    if not pieces:
        raise errors.refuse("pieces", "must hold an object", 0, "Use another scene.")
    errors.one_of("method of reference", REAL, depth_m)
    for name, image in depth_m.items():
        if image.shape != reference_m.shape:
            raise errors.refuse(
                f"depth of {name}",
                f"must be of shape {reference_m.shape}",
                image.shape,
                "Give all of one view.",
            )
    reference = cloud.surface(reference_m, info)
    tasks = [_pose(piece, reference, disturbance, trials, seed) for piece in pieces]
    names = tuple(f"{piece.scene}/{piece.name}" for piece in pieces)
    outcomes = {}
    for name, image in depth_m.items():
        pose_errors = np.full((2, len(pieces), trials), np.nan)
        visible = [visible_share(piece, image) >= LEAST_VISIBLE for piece in pieces]
        shown = cloud.surface(image, info) if any(visible) else None
        for number, (piece, task) in enumerate(zip(pieces, tasks, strict=True)):
            if shown is None or not visible[number]:
                continue
            scene = shown.cloud(task.pixels)
            if len(scene) < FEWEST_POINTS:
                continue
            for trial, motion in enumerate(task.motions):
                correction = register(task.model.moved(motion), scene)
                error = pose_error(correction @ motion, piece.centre_m)
                pose_errors[:, number, trial] = error.position_m, error.rotation
        outcomes[name] = Outcome(objects=names, position_m=pose_errors[0], rotation=pose_errors[1])
    return outcomes


def pool(scenes: Sequence[Mapping[str, Outcome]]) -> dict[str, Outcome]:
    """Pool the outcomes of several scenes.

    Raises:
        InputError: if there is no scene, or the scenes differ in methods or number of trials.
    """
    if not scenes:
        raise errors.refuse("scenes", "must not be empty", 0, "Align in at least one.")
    kinds = {(frozenset(scene), scene[REAL].position_m.shape[1]) for scene in scenes}
    if len(kinds) > 1:
        raise errors.refuse(
            "scenes",
            "must share methods and trials",
            len(kinds),
            "Use the same methods and trials.",
        )
    return {
        name: Outcome(
            objects=tuple(name_ for scene in scenes for name_ in scene[name].objects),
            position_m=np.concatenate([scene[name].position_m for scene in scenes]),
            rotation=np.concatenate([scene[name].rotation for scene in scenes]),
        )
        for name in scenes[0]
    }
