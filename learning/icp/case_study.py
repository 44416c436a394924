"""The ICP case study on captures: alignment of objects in each method's depth, and comparisons."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.icp import objects, study
from starling.learning.icp.objects import Piece
from starling.learning.icp.study import REAL, Disturbance, Outcome
from starling.learning.sampling import sampling
from starling.patterns import errors
from starling.patterns.errors import InputError, whole_number
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.console import progress


class PoseMetrics(NamedTuple):
    """The paper's four metrics, or values of the same structure."""

    position_mean_pct: float
    position_var_pct: float
    rotation_mean_pct: float
    rotation_var_pct: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """A method compared with real depth."""

    difference: (
        PoseMetrics  # |method - real| / real [percent]; NaN if no object is visible in both.
    )
    trials: int  # Alignments in either depth.
    objects: int  # Objects visible in both.
    only_in_real: int  # Objects visible in real depth only.
    only_in_method: int  # Objects visible in the method's depth only.


@dataclass(frozen=True, kw_only=True, slots=True)
class Interval:
    """95 % interval of the advantage of one method over another [percentage points]."""

    low: PoseMetrics
    middle: PoseMetrics
    high: PoseMetrics


def against_real(method: Outcome, real: Outcome) -> Comparison:
    """Compare mean and variance of a method's errors with those in real depth, as in Table I.

    Raises:
        InputError: if the two have different objects.
    """
    both = _seen(method, real)
    once = np.ones((1, np.count_nonzero(both)))
    values = np.full(4, np.nan)
    if both.any():
        values = _difference(_figures(method, both, once), _figures(real, both, once))[0]
    return Comparison(
        difference=PoseMetrics(*values.tolist()),
        trials=real.position_m[both].size,
        objects=int(np.count_nonzero(both)),
        only_in_real=int(np.count_nonzero(real.visible & ~method.visible)),
        only_in_method=int(np.count_nonzero(method.visible & ~real.visible)),
    )


def paired_advantage(
    method: Outcome, baseline: Outcome, real: Outcome, *, seed: int, draws: int = 2000
) -> Interval:
    """Bootstrap the advantage of a method: the other method's difference from real less its own.

    Objects are resampled with replacement, with all their trials and jointly for all three
    (paired). A method is closer to real if the interval is above zero. Objects of one room are
    correlated, so that intervals are slightly too narrow.

    Args:
        method: errors of the method.
        baseline: errors of the method it is compared with.
        real: errors in real depth.
        seed: seed of the draws.
        draws: 100 or more.

    Raises:
        InputError: see `against_real`; or if there are fewer draws or fewer than two objects.
    """
    whole_number("draws", draws, 100, 10**6)
    both = _seen(method, real) & baseline.visible
    objects = int(np.count_nonzero(both))
    if objects < 2:
        raise errors.refuse(
            "objects seen in all", "must be two or more", objects, "Use more scenes."
        )
    generator = np.random.default_rng(seed)
    times = generator.multinomial(objects, np.full(objects, 1 / objects), size=draws)
    truth = _figures(real, both, times)
    gain = _difference(_figures(baseline, both, times), truth)
    gain -= _difference(_figures(method, both, times), truth)
    low, middle, high = np.nanpercentile(gain, (2.5, 50, 97.5), axis=0).tolist()
    return Interval(low=PoseMetrics(*low), middle=PoseMetrics(*middle), high=PoseMetrics(*high))


def _seen(method: Outcome, real: Outcome) -> NDArray[np.bool_]:
    if method.objects != real.objects:
        raise errors.refuse(
            "objects",
            "must be the same in both",
            f"{len(method.objects)} and {len(real.objects)}",
            "Give outcomes of one study.",
        )
    return method.visible & real.visible


def _figures(
    outcome: Outcome, chosen: NDArray[np.bool_], times: NDArray[np.floating | np.integer]
) -> NDArray[np.float64]:
    """Mean and variance of position, then of rotation (draws, 4), weighted by `times`."""
    columns = []
    for value in (outcome.position_m[chosen], outcome.rotation[chosen]):
        offset = value.mean()  # Subtracting it avoids cancellation in the variance.
        total = times.sum(axis=1)
        mean = times @ (value - offset).mean(axis=1) / total
        square = times @ ((value - offset) ** 2).mean(axis=1) / total
        columns += [mean + offset, square - mean**2]
    return np.stack(columns, axis=1)


def _difference(method: NDArray[np.float64], real: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative absolute difference [percent]; NaN where the real value is zero."""
    base = np.where(real > 0, real, np.nan)
    return 100 * np.abs(method - real) / base


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
            name: sampling.draw_frame(name, view.probability, view.example, seed=seed).depth_m
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
            compared = against_real(outcome, outcomes[REAL])
            table[name] = {
                **compared.difference._asdict(),
                "trials": compared.trials,
                "objects": compared.objects,
                "hidden": compared.only_in_real,
                "shown": compared.only_in_method,
            }
    return table
