"""The case study on captures: objects of every scene, aligned in what each method told of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from starling.learning.evaluation.evaluate import Told
from starling.learning.icp import comparison, objects, study
from starling.learning.icp.alignment import Disturbance
from starling.learning.icp.objects import Piece
from starling.learning.icp.study import REAL, Outcome
from starling.learning.sampling import drawn_frame
from starling.patterns import errors
from starling.patterns.errors import InputError
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.console import progress

_SLIGHT = Disturbance()


def case_study(
    captures: CaptureSet,
    told: Mapping[str, Sequence[Told]],
    *,
    trials: int,
    disturbance: Disturbance = _SLIGHT,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> dict[str, Outcome]:
    """Align the objects of scenes in the device's depth and in what methods draw.

    Args:
        captures: with the device's own depth.
        told: by method, the same scenes of these captures.
        trials: first guesses an object.
        disturbance: how far they are off.
        seed: of holes and first guesses.
        track: wraps the loop over scenes.

    Returns:
        Pose errors by method; the device's are under `REAL`.

    Raises:
        InputError: as `study.align`, or if no scene holds an object whose shape tells its pose.
    """
    captured = {scene.name: scene for scene in captures.scenes}
    outcomes = []
    for views in track(list(zip(*told.values(), strict=True)), "align"):
        example = views[0].example
        scene = captured[example.scene]
        pieces = pieces_of(scene)
        if not pieces:
            continue
        device_m = scene.frame(scene.frames[0]).depth_m
        assert device_m is not None  # `captured.example` refuses.
        depths = {
            name: drawn_frame.draw(name, view.probability, view.example, seed=seed).depth_m
            for name, view in zip(told, views, strict=True)
        }
        outcomes.append(
            study.align(
                pieces,
                example.depth_m,
                {REAL: device_m, **depths},
                example.info,
                disturbance=disturbance,
                trials=trials,
                seed=seed,
            )
        )
    if not outcomes:
        raise _nothing_to_align()
    return study.pool(outcomes)


def check_objects(scenes: Iterable[CapturedScene]) -> None:
    """Refuse scenes that have nothing to align.

    Raises:
        InputError: if none holds an object whose shape tells its pose.
    """
    if not any(map(pieces_of, scenes)):
        raise _nothing_to_align()


def _nothing_to_align() -> InputError:
    return errors.refuse(
        "objects",
        "must tell their pose by their shape",
        "none that does",
        "Show things 0.1 to 0.6 m long.",
    )


def pieces_of(scene: CapturedScene) -> list[Piece]:
    """Find a scene's objects: those of its label where it has one, else pieces of its surface.

    Raises:
        InputError: if it has no reference depth.
    """
    reference_m, label = scene.truth_m(), scene.label()
    if reference_m is None:
        raise errors.refuse(
            f"scene {scene.name}", "must have reference depth", "no truth.png", "Leave it out."
        )
    if label is None:
        return objects.in_room(reference_m, scene.info, scene=scene.name, room=scene.room)
    return objects.by_label(reference_m, label, scene.info, scene=scene.name, room=scene.room)


def figures(outcomes: Mapping[str, Outcome]) -> dict[str, dict[str, Any]]:
    """Give Table I of the paper, with what it stands on.

    Returns:
        By method: |simulated - real| / real [percent] as `position_mean_pct`, `position_var_pct`,
        `rotation_mean_pct`, `rotation_var_pct`; numbers of `trials`, of `objects` seen in both
        depths, `hidden` and `shown` in the method's alone.
    """
    found = {}
    for name, outcome in outcomes.items():
        if name != REAL:
            one = comparison.against_real(outcome, outcomes[REAL])
            found[name] = {
                **one.difference._asdict(),
                "trials": one.trials,
                "objects": one.objects,
                "hidden": one.hidden,
                "shown": one.shown,
            }
    return found
