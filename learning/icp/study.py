"""The seed paper's case study: do objects align as badly in a method's depth as in the real one?

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
from starling.patterns.whole import whole
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import progress
from starling.sim.randomness import generator

REAL = "real"  # The device's own depth image, which all others are compared with.
LEAST_VISIBLE = 0.1  # An object of which less than this share has depth is hidden.
FEWEST_POINTS = 200  # As is one with fewer scene points around it.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Outcome:
    """Pose errors in one method's depth images, (objects, trials); NaN where one is hidden."""

    objects: tuple[str, ...]  # `scene/name`, in the same order for all methods.
    position_m: NDArray[np.float64]
    rotation: NDArray[np.float64]  # 1 - |<q1, q2>|.

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which objects are there to be aligned with (objects,)."""
        return np.asarray(np.isfinite(self.position_m).all(axis=1))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Posed:
    """What all methods share of one object."""

    pixels: Mask
    model: Cloud
    motions: tuple[Points, ...]


def _pose(
    piece: Piece, reference: Surface, disturbance: Disturbance, trials: int, seed: int
) -> _Posed:
    draw = generator(seed, 0, "learning", f"icp {piece.scene}/{piece.name}")
    return _Posed(
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
    """Disturb every object of a scene and align it again in every method's depth image.

    Methods meet the same first guesses at the same pixels, so their difference is the depth's.

    Args:
        pieces: objects of one scene, at least one.
        reference_m: (h, w) z [m] that they were cut from.
        depth_m: by method, (h, w) z [m], NaN where there is no depth; `REAL` among them.
        info: intrinsics and baseline.
        disturbance: how far first guesses are off.
        trials: first guesses an object, 2 or more.
        seed: fixes them.
        track: wraps the loops over objects.

    Raises:
        InputError: no object, no real depth, an image without depth or of another shape, or fewer
            than two trials.
    """
    whole("trials", trials, 2, 10**6)
    if not pieces:
        raise errors.refuse("pieces", "must hold an object", 0, "Take another scene.")
    errors.one_of("method of reference", REAL, depth_m)
    for name, image in depth_m.items():
        if image.shape != reference_m.shape:
            raise errors.refuse(
                f"depth of {name}",
                f"must be of shape {reference_m.shape}",
                image.shape,
                "Take all from one view.",
            )
    reference = cloud.surface(reference_m, info)
    posed = [_pose(piece, reference, disturbance, trials, seed) for piece in pieces]
    names = tuple(f"{piece.scene}/{piece.name}" for piece in pieces)
    outcomes = {}
    for name, image in depth_m.items():
        errors_of = np.full((2, len(pieces), trials), np.nan)
        seen = [alignment.visible_share(piece, image) >= LEAST_VISIBLE for piece in pieces]
        shown = cloud.surface(image, info) if any(seen) else None
        for number, (piece, at) in enumerate(
            zip(track(pieces, f"align in {name}"), posed, strict=True)
        ):
            if shown is None or not seen[number]:
                continue
            scene = shown.cloud(at.pixels)
            if len(scene) < FEWEST_POINTS:
                continue
            for trial, motion in enumerate(at.motions):
                found = alignment.register(at.model.moved(motion), scene)
                error = alignment.pose_error(found @ motion, piece.centre_m)
                errors_of[:, number, trial] = error.position_m, error.rotation
        outcomes[name] = Outcome(objects=names, position_m=errors_of[0], rotation=errors_of[1])
    return outcomes


def pool(scenes: Sequence[Mapping[str, Outcome]]) -> dict[str, Outcome]:
    """Outcomes of several scenes as one.

    Raises:
        InputError: if there is no scene, or the scenes have other methods or numbers of trials.
    """
    if not scenes:
        raise errors.refuse("scenes", "must not be empty", 0, "Align in at least one.")
    kinds = {(frozenset(scene), scene[REAL].position_m.shape[1]) for scene in scenes}
    if len(kinds) > 1:
        raise errors.refuse(
            "scenes", "must share methods and trials", len(kinds), "Align in all of them alike."
        )
    return {
        name: Outcome(
            objects=tuple(one for scene in scenes for one in scene[name].objects),
            position_m=np.concatenate([scene[name].position_m for scene in scenes]),
            rotation=np.concatenate([scene[name].rotation for scene in scenes]),
        )
        for name in scenes[0]
    }
