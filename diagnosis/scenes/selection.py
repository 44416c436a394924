"""Selection of scenes: pairs of two capture sets, complete scenes, and held-out test rooms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from starling.calibration.plausibility import correspondence
from starling.calibration.plausibility.reference_scale import refuse_swapped
from starling.diagnosis.scenes import rooms
from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.console import progress
from starling.sim.sensor.sensor import Sensor

ROOMS_PER_TEST_ROOM = 4  # One room in so many is held out as a test room.
FEWEST_ROOMS = 2  # Least number of rooms for cross-validation.
_ROOMS_FOR_INTERVAL = 8  # Number of rooms from which test rooms suffice for an interval.
_GEOMETRY = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m")

_Contents = tuple[bool, bool]  # Infrared pairs, device depth.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ScenePairs:
    """Scenes of a capture set, each paired with the same scene of a second set."""

    pairs: tuple[tuple[CapturedScene, CapturedScene | None], ...]  # None without a second set.
    unpaired: tuple[str, ...]  # Names of scenes that only one of the two sets has.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneSelection:
    """Scenes of the captures, split for training and evaluation."""

    complete: list[SceneModel]  # Scenes that hold all that most scenes hold.
    incomplete: list[SceneModel]
    training: list[SceneModel]  # Complete scenes that effects are fitted to.
    held_out: list[SceneModel]  # The other complete scenes.
    unpaired: tuple[str, ...]  # Names of scenes that only one of two capture sets has.


def ignore_scene(scene: SceneModel) -> None:
    """Announce nothing of a loaded scene."""
    del scene


def load_scenes(
    captures: CaptureSet,
    sensor: Sensor,
    against: CaptureSet | None,
    *,
    track: progress.Progress = progress.silent,
    announce: Callable[[SceneModel], None] = ignore_scene,
) -> SceneSelection:
    """Load all scenes, set incomplete ones aside, and hold out test rooms.

    Args:
        captures: capture set.
        sensor: the base.
        against: capture set that it is compared with; None if there is none.
        track: wraps the loop over scenes to report progress.
        announce: takes each scene as soon as it is loaded.

    Raises:
        InputError: as `pair_scenes` and `load_scene_model`. Also if left and right are swapped or
            equal.
    """
    paired = pair_scenes(captures, against)
    loaded = []
    for scene, reference in track(paired.pairs, "scenes"):
        loaded.append(load_scene_model(scene, sensor, against=reference))
        announce(loaded[-1])
    refuse_swapped_pairs(loaded)
    complete, incomplete = split_complete(loaded)
    training, held_out = split_test_rooms(complete)
    return SceneSelection(
        complete=complete,
        incomplete=incomplete,
        training=training,
        held_out=held_out,
        unpaired=paired.unpaired,
    )


def refuse_swapped_pairs(scenes: Sequence[SceneModel]) -> None:
    """Refuse scenes whose left and right images are swapped or equal.

    Raises:
        InputError: as said, or if images are smaller than 64 x 64.
    """
    for scene in scenes:
        if isinstance(scene.real, StereoObservation):
            left, right = scene.real.left[0], scene.real.right[0]
            refuse_swapped(scene.name, correspondence.find(left, right))


def pair_scenes(captures: CaptureSet, against: CaptureSet | None) -> ScenePairs:
    """Pair scenes by name.

    Args:
        captures: capture set.
        against: capture set that it is compared with; None if there is none.

    Raises:
        InputError: if a set holds several cameras, or if the sets differ in size or geometry, or
            if they have no scene in common.
    """
    captures.refuse_mixed()
    if against is None:
        return ScenePairs(pairs=tuple((scene, None) for scene in captures.scenes), unpaired=())
    against.refuse_mixed()
    for name in _GEOMETRY:
        first, second = (getattr(captured.info, name) for captured in (captures, against))
        if first != second:
            raise refuse(
                "captures against others",
                f"must be of one {name}",
                (first, second),
                "Rectify both sets to the same geometry.",
            )
    partners = {scene.name: scene for scene in against.scenes}
    pairs = tuple(
        (scene, partners[scene.name]) for scene in captures.scenes if scene.name in partners
    )
    if not pairs:
        raise refuse(
            "captures against others",
            "must have a scene in common",
            f"{captures.path} and {against.path}",
            "Scenes are the same if their folders have one name.",
        )
    names = {scene.name for scene in captures.scenes}
    return ScenePairs(pairs=pairs, unpaired=tuple(sorted(names ^ {*partners})))


def split_complete(
    scene_models: Sequence[SceneModel],
) -> tuple[list[SceneModel], list[SceneModel]]:
    """Separate scenes that hold all that most scenes hold from incomplete ones.

    A single incomplete scene would otherwise exclude a segment for all scenes. In a tie the
    contents with infrared count as the most frequent.

    Args:
        scene_models: at least one.

    Returns:
        Complete scenes and incomplete scenes.
    """
    contents = [_contents(scene) for scene in scene_models]
    required = max(set(contents), key=lambda kind: (contents.count(kind), kind))
    complete = [
        all(has >= must for has, must in zip(kind, required, strict=True)) for kind in contents
    ]
    return (
        [scene for scene, holds in zip(scene_models, complete, strict=True) if holds],
        [scene for scene, holds in zip(scene_models, complete, strict=True) if not holds],
    )


def _contents(scene: SceneModel) -> _Contents:
    return isinstance(scene.real, StereoObservation), isinstance(scene.real, DepthObservation)


def split_test_rooms(
    scene_models: Sequence[SceneModel],
) -> tuple[list[SceneModel], list[SceneModel]]:
    """Hold out test rooms at random, on which the reduction of the gap is measured.

    One room in four is held out, and of eight rooms or more at least three. With fewer than four
    rooms none is held out.

    Returns:
        Training scenes and held-out scenes.
    """
    names = sorted({scene.room for scene in scene_models})
    order = np.random.default_rng(0).permutation(len(names))
    least = rooms.FEWEST if len(names) >= _ROOMS_FOR_INTERVAL else 0
    count = max(len(names) // ROOMS_PER_TEST_ROOM, least)
    test_rooms = {names[number] for number in order[:count]}
    training = [scene for scene in scene_models if scene.room not in test_rooms]
    return training, [scene for scene in scene_models if scene.room in test_rooms]
