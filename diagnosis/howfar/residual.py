"""The learned residual: a bound on the gap reduction, and a test of the accepted effects.

*Bound*: the figures of a network that corrects the simulated holes, on held-out scenes. Any model
with the same inputs can close as much of the gap.
*Test*: if the accepted effects are true, the network gains no more with them applied than without
a gap. If they are surrogates, it gains as much as before. Even without a gap it gains, because it
learns how uncertain a few simulated draws are.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.diagnosis.howfar.distances import hole_figures
from starling.diagnosis.howfar.evaluation import DRAWS, OTHER, Settings
from starling.diagnosis.howfar.reduction import gap_reductions
from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.selection import SceneSelection
from starling.learning.data.example import Example, Physics, known_holes
from starling.learning.data.physics import physics_probability
from starling.learning.method import Method
from starling.patterns.errors import InputError, refuse
from starling.sim.console import progress
from starling.sim.stereo.depth import depth_from_disparity

METHOD = "hybrid"  # Name in `starling.learning.registry`.
_SEED = 0
_BRIER = "ndp_brier"
_GAIN = "gain"

_Gains = Sequence[Mapping[str, float]]  # One mapping per scene.


@dataclass(frozen=True, kw_only=True, slots=True)
class Absorption:
    """Share of the residual's gain that the accepted effects absorb.

    A gain is the Brier score of physics alone minus that with the residual, mean over scenes.
    """

    gain_before: float  # Gain on the base.
    gain_after: float | None  # Gain with the accepted effects; None without any.
    gain_floor: float  # Gain if a simulated capture replaces the real one.
    closable: bool  # Whether before is significantly above floor.
    share: float | None  # (before - after) / (before - floor); None if unknown.
    interval: tuple[float, float] | None  # 95 % over rooms; None with fewer than three.


@dataclass(frozen=True, kw_only=True, slots=True)
class LearnedResidual:
    """Figures of `hole_figures` on held-out scenes, without and with the learned residual."""

    alone: dict[str, float]  # Physics of the base alone, mean over scenes.
    bound: dict[str, float]  # Physics with the residual, mean over scenes.
    absorption: Absorption


@dataclass(frozen=True, slots=True)
class _SceneFigures:
    """Figures of each held-out scene."""

    alone: list[dict[str, float]]
    corrected: list[dict[str, float]]

    @property
    def gains(self) -> list[dict[str, float]]:
        pairs = zip(self.alone, self.corrected, strict=True)
        return [{_GAIN: alone[_BRIER] - corrected[_BRIER]} for alone, corrected in pairs]


def learn_residual(
    method: Method,
    training: Sequence[SceneModel],
    held_out: Sequence[SceneModel],
    settings: Settings,
    *,
    track: progress.Progress = progress.silent,
) -> LearnedResidual:
    """Learn the residual of the base, of the simulator with effects, and without a gap.

    Holes are those of the device's own depth. Without it, our matcher's count.

    Args:
        method: method that corrects physics, `METHOD`.
        training: scenes to learn from.
        held_out: scenes to evaluate on.
        settings: value by accepted effect.
        track: wraps loops that take long.

    Raises:
        InputError: if no scene is held out, or the training scenes do not suffice
            (`starling.learning.data.example`).
    """
    if not held_out:
        rule = "must be at least 1"
        raise refuse("held-out scenes", rule, 0, "Capture at least four rooms.")

    scenes = [*training, *held_out]

    def simulated(values: Settings) -> list[Physics]:
        tracked = track(scenes, "simulated holes")
        return [scene.physics(values, seeds=range(DRAWS)) for scene in tracked]

    def figures(
        physics: Sequence[Physics], real: Callable[[SceneModel], SceneObservation]
    ) -> _SceneFigures:
        pairs = zip(scenes, physics, strict=True)
        examples = [_example(scene, inputs, real(scene)) for scene, inputs in pairs]
        split = len(training)
        held_out_examples = zip(examples[split:], physics[split:], strict=True)
        return _evaluate(method, examples[:split], held_out_examples, track)

    base = simulated({})
    with_effects = simulated(settings) if settings else base
    before = figures(base, lambda scene: scene.real)
    after = figures(with_effects, lambda scene: scene.real) if settings else None
    floor = figures(
        with_effects,
        lambda scene: scene.observe(scene.request(settings, seed=OTHER, device=OTHER)),
    )
    return LearnedResidual(
        alone=_mean(before.alone),
        bound=_mean(before.corrected),
        absorption=_absorption(
            before.gains, after and after.gains, floor.gains, [scene.room for scene in held_out]
        ),
    )


def try_residual(
    method: Method | None,
    scenes: SceneSelection,
    settings: Settings,
    *,
    track: progress.Progress = progress.silent,
) -> tuple[LearnedResidual | None, list[str]]:
    """Learn the residual if that is requested and possible.

    Args:
        method: as `learn_residual`; None learns nothing.
        scenes: training and held-out scenes.
        settings: value by accepted effect.
        track: wraps loops that take long.

    Returns:
        The residual, and the limits of the diagnosis that follow: a failure stops nothing else.
    """
    if method is None:
        return None, []
    try:
        learned = learn_residual(method, scenes.training, scenes.held_out, settings, track=track)
    except InputError as error:
        return None, [f"No residual was learned: {error}"]
    return learned, []


def _evaluate(
    method: Method,
    training: Sequence[Example],
    held_out: Iterable[tuple[Example, Physics]],
    track: progress.Progress,
) -> _SceneFigures:
    with tempfile.TemporaryDirectory() as folder:
        predictor = method.fit(training, folder=Path(folder), seed=_SEED, track=track)
    figures = _SceneFigures([], [])
    for example, physics in held_out:
        known = known_holes(example)
        alone = physics_probability(physics)
        figures.alone.append(hole_figures(alone, *known))
        figures.corrected.append(hole_figures(predictor.probability(example), *known))
    return figures


def _example(scene: SceneModel, physics: Physics, real: SceneObservation) -> Example:
    strata = scene.strata
    info = strata.info
    return Example(
        scene=scene.name,
        room=scene.room,
        info=info,
        depth_m=depth_from_disparity(
            strata.disparity_px, focal_px=info.fx_px, baseline_m=info.baseline_m
        ),
        ndp=~np.isfinite(real.depth_px[0]),
        counted=strata.counted,
        physics=physics,
    )


def _mean(scenes: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each figure over the scenes that have it; NaN if none has."""
    means = {}
    for name in scenes[0]:
        known = [figures[name] for figures in scenes if np.isfinite(figures[name])]
        means[name] = float(np.mean(known)) if known else float("nan")
    return means


def _absorption(
    before: _Gains, after: _Gains | None, floor: _Gains, rooms: Sequence[str]
) -> Absorption:
    gain = gap_reductions(before, before if after is None else after, floor, rooms)[_GAIN]
    share, interval = None, None
    if after is not None and gain.closed_pct is not None:
        share = gain.closed_pct / 100
        if gain.interval is not None:
            interval = (gain.interval[0] / 100, gain.interval[1] / 100)
    return Absorption(
        gain_before=gain.before,
        gain_after=None if after is None else gain.after,
        gain_floor=gain.floor,
        closable=gain.closed_pct is not None,
        share=share,
        interval=interval,
    )
