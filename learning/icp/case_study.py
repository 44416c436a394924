"""The ICP case study on captures: alignment of objects in each method's depth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from starling.learning.evaluation.evaluate import HolePrediction
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
    predictions: Mapping[str, Sequence[HolePrediction]],
    *,
    trials: int,
    disturbance: Disturbance = _SLIGHT,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> dict[str, Outcome]:
    """Align the objects of scenes in the device's depth and in the depth sampled by methods.

    Args:
        captures: captures with the device's own depth.
        predictions: predictions by method, for the same scenes of these captures.
        trials: initial poses per object.
        disturbance: error of the initial poses.
        seed: seed of holes and initial poses.
        track: wraps the loop over scenes.

    Returns:
        Pose errors by method; those in the device's depth are under `REAL`.

    Raises:
        InputError: see `study.align`; or if no scene has an object whose shape determines its pose.
    """
    captured = {scene.name: scene for scene in captures.scenes}
    outcomes = []
    for views in track(list(zip(*predictions.values(), strict=True)), "align"):
        example = views[0].example
        scene = captured[example.scene]
        pieces = pieces_of(scene)
        if not pieces:
            continue
        device_m = scene.frame(scene.frames[0]).depth_m
        assert device_m is not None  # Checked by `captured.example`.
        depths = {
            name: drawn_frame.draw(name, view.probability, view.example, seed=seed).depth_m
            for name, view in zip(predictions, views, strict=True)
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
    """Refuse scenes without objects to align.

    Raises:
        InputError: if no scene has an object whose shape determines its pose.
    """
    if not any(map(pieces_of, scenes)):
        raise _nothing_to_align()


def _nothing_to_align() -> InputError:
    return errors.refuse(
        "objects",
        "must have a shape that determines their pose",
        "none",
        "Capture objects 0.1 to 0.6 m long.",
    )


def pieces_of(scene: CapturedScene) -> list[Piece]:
    """Find a scene's objects: those of its label image if there is one, else convex pieces.

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
    """Return Table I of the paper, with the numbers of trials and objects.

    Returns:
        By method: |simulated - real| / real [percent] as `position_mean_pct`, `position_var_pct`,
        `rotation_mean_pct`, `rotation_var_pct`; numbers of `trials`, of `objects` visible in both
        depths, and of objects visible only in the real (`hidden`) or only in the method's depth
        (`shown`).
    """
    table = {}
    for name, outcome in outcomes.items():
        if name != REAL:
            compared = comparison.against_real(outcome, outcomes[REAL])
            table[name] = {
                **compared.difference._asdict(),
                "trials": compared.trials,
                "objects": compared.objects,
                "hidden": compared.hidden,
                "shown": compared.shown,
            }
    return table
