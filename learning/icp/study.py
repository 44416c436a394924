"""The seed paper's case study: are alignment errors in a method's depth like those in real depth?

C. Sweeney, G. Izatt and R. Tedrake, A Supervised Approach to Predicting Noise in Depth Images,
ICRA 2019, section IV-B.2 and Table I.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Mask
from starling.learning.icp import alignment, cloud
from starling.learning.icp.alignment import Disturbance
from starling.learning.icp.cloud import Cloud, Points, Surface
from starling.learning.icp.objects import Piece
from starling.patterns import errors
from starling.patterns.errors import whole_number
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import progress
from starling.sim.randomness import generator

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
        pixels=alignment.scene_pixels(piece, reference, draw),
        model=alignment.model_points(piece, draw),
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
    track: progress.Progress = progress.silent,
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
        track: wraps the loops over objects.

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
        visible = [alignment.visible_share(piece, image) >= LEAST_VISIBLE for piece in pieces]
        shown = cloud.surface(image, info) if any(visible) else None
        for number, (piece, task) in enumerate(
            zip(track(pieces, f"align in {name}"), tasks, strict=True)
        ):
            if shown is None or not visible[number]:
                continue
            scene = shown.cloud(task.pixels)
            if len(scene) < FEWEST_POINTS:
                continue
            for trial, motion in enumerate(task.motions):
                correction = alignment.register(task.model.moved(motion), scene)
                error = alignment.pose_error(correction @ motion, piece.centre_m)
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
