"""The learned residual as a bound and as a witness.

*Bound*: what a network that corrects the base's holes reaches on scenes that had no say: anything
that knows what the network knows can close as much.
*Witness*: with a true effect in the simulator the network gains no more than where nothing is off;
with a stand-in it gains as much as before. Where nothing is off it gains too: it learns how sure a
few draws are.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.diagnosis.howfar import holes
from starling.diagnosis.howfar.evaluation import DRAWS, OTHER, Settings
from starling.diagnosis.howfar.reduction import closed
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.scene_model import Subject
from starling.learning.data.example import Example, Physics
from starling.learning.data.learnable import known_holes
from starling.learning.data.physics_probability import physics_probability
from starling.learning.method import Method
from starling.patterns.errors import refuse
from starling.sim.console import progress
from starling.sim.stereo.depth import depth_from_disparity

METHOD = "hybrid"  # Of `starling.learning.registry`.
_SEED = 0
_BRIER = "ndp_brier"
_GAIN = "gain"

_Gains = Sequence[Mapping[str, float]]  # Of each scene.


@dataclass(frozen=True, kw_only=True, slots=True)
class Absorption:
    """How much less a residual gains with the accepted effects in.

    A gain is the Brier score of physics alone less that with the residual, mean over scenes.
    """

    gain_before: float  # On the base.
    gain_after: float | None  # With the accepted effects; None where there is none.
    gain_floor: float  # Of another simulated capture in the real one's place.
    closable: bool  # Whether before is above floor for sure.
    share: float | None  # Before less after, over before less floor; None where not known.
    interval: tuple[float, float] | None  # 95 %, bootstrap over rooms; None of few.


@dataclass(frozen=True, kw_only=True, slots=True)
class Residual:
    """What was learnt, judged on locked scenes; figures by `starling.diagnosis.howfar.holes`."""

    alone: dict[str, float]  # Of the base's physics, mean over scenes.
    bound: dict[str, float]  # With the residual.
    absorption: Absorption


@dataclass(frozen=True, slots=True)
class _Told:
    """Figures of each locked scene."""

    alone: list[dict[str, float]]
    corrected: list[dict[str, float]]

    @property
    def gains(self) -> list[dict[str, float]]:
        pairs = zip(self.alone, self.corrected, strict=True)
        return [{_GAIN: one[_BRIER] - other[_BRIER]} for one, other in pairs]


def learn(
    method: Method,
    asked: Sequence[Subject],
    locked: Sequence[Subject],
    settings: Settings,
    *,
    track: progress.Progress = progress.silent,
) -> Residual:
    """Learn the residual of the base, of the simulator with effects, and of one that is right.

    Holes are those of the device's own depth, where it has none our matcher's.

    Args:
        method: that corrects physics, `METHOD`.
        asked: subjects to learn from.
        locked: subjects to judge on.
        settings: value by accepted effect.
        track: wraps loops that take long.

    Raises:
        InputError: if no scene is locked, or nothing can be learnt from those that are asked
            (`starling.learning.data.learnable`).
    """
    if not locked:
        raise refuse("locked scenes", "must be at least 1", 0, "Take captures of four rooms.")

    subjects = [*asked, *locked]

    def simulated(by: Settings) -> list[Physics]:
        each = track(subjects, "holes simulated")
        return [one.physics(by, seeds=range(DRAWS)) for one in each]

    def told(physics: Sequence[Physics], real: Callable[[Subject], Reading]) -> _Told:
        pairs = zip(subjects, physics, strict=True)
        many = [_example(one, known, real(one)) for one, known in pairs]
        return _judged(method, many[: len(asked)], many[len(asked) :], track)

    base = simulated({})
    with_effects = simulated(settings) if settings else base
    before = told(base, lambda one: one.real)
    after = told(with_effects, lambda one: one.real) if settings else None
    floor = told(with_effects, lambda one: one.another(OTHER).like_captured(settings, seed=OTHER))
    return Residual(
        alone=_mean(before.alone),
        bound=_mean(before.corrected),
        absorption=_absorption(
            before.gains, after and after.gains, floor.gains, [one.room for one in locked]
        ),
    )


def _judged(
    method: Method,
    learnt_from: Sequence[Example],
    held: Sequence[Example],
    track: progress.Progress,
) -> _Told:
    with tempfile.TemporaryDirectory() as folder:
        predictor = method.fit(learnt_from, folder=Path(folder), seed=_SEED, track=track)
    found = _Told([], [])
    for one in held:
        assert one.physics is not None
        known = known_holes(one)
        found.alone.append(holes.figures(physics_probability(one.physics), *known))
        found.corrected.append(holes.figures(predictor.probability(one), *known))
    return found


def _example(of: Subject, physics: Physics, real: Reading) -> Example:
    ground = of.ground
    info = ground.info
    return Example(
        scene=of.name,
        room=of.room,
        info=info,
        depth_m=depth_from_disparity(
            ground.disparity_px, focal_px=info.fx_px, baseline_m=info.baseline_m
        ),
        ndp=~np.isfinite(real.depth_px[0]),
        counted=ground.counted,
        physics=physics,
    )


def _mean(scenes: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each figure over the scenes that have it; NaN where none has."""
    found = {}
    for name in scenes[0]:
        known = [one[name] for one in scenes if np.isfinite(one[name])]
        found[name] = float(np.mean(known)) if known else float("nan")
    return found


def _absorption(
    before: _Gains, after: _Gains | None, floor: _Gains, rooms: Sequence[str]
) -> Absorption:
    gain = closed(before, before if after is None else after, floor, rooms)[_GAIN]
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
