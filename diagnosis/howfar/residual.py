"""The learned residual as a bound and as a witness.

*Bound*: what a network that corrects the base's holes reaches on scenes that had no say. At least
so much can be closed by anything that knows what the network knows.
*Witness*: with a true effect in the simulator the network has less to learn; with a stand-in it has
as much as before.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagnosis.howfar import holes
from diagnosis.howfar.closed import closed
from diagnosis.howfar.judged import DRAWS
from diagnosis.subject import Subject
from learning import registry
from learning.example import Example
from learning.learnable import known_holes
from learning.physics_probability import physics_probability
from patterns.errors import refuse
from sim import progress
from sim.depth import depth_from_disparity
from sim.effects.effect import Value

_METHOD = "hybrid"
_SEED = 0
_BRIER = "ndp_brier"
_GAIN = "gain"


@dataclass(frozen=True, kw_only=True, slots=True)
class Absorption:
    """How much less a residual has to learn with the accepted effects in.

    A gain is the Brier score of physics alone less that with the residual, mean over scenes.
    """

    gain_before: float  # On the base.
    gain_after: float  # With the accepted effects.
    share: float | None  # 1 - after / before; None where the residual does not gain for sure.
    interval: tuple[float, float] | None  # 95 %, bootstrap over scenes; None of one scene.


@dataclass(frozen=True, kw_only=True, slots=True)
class Residual:
    """What was learnt, judged on locked scenes; figures by `diagnosis.howfar.holes`."""

    alone: dict[str, float]  # Of the base's physics, mean over scenes.
    bound: dict[str, float]  # With the residual.
    absorption: Absorption | None  # None where no effect is accepted.


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
    asked: Sequence[Subject],
    locked: Sequence[Subject],
    settings: Mapping[str, Value],
    *,
    tell: progress.Progress = progress.silent,
) -> Residual:
    """Learn the residual of the base, and of the simulator with effects, and judge both.

    Holes are those of the device's own depth, where it has none our matcher's.

    Args:
        asked: subjects to learn from.
        locked: subjects to judge on.
        settings: value by accepted effect; where there is none the base alone is learnt from.
        tell: wraps loops that take long.

    Raises:
        InputError: if no scene is locked, one has no depth, or nothing can be learnt from those
            that are asked (`learning.learnable`).
    """
    if not locked:
        raise refuse("locked scenes", "must be at least 1", 0, "Take captures of four rooms.")
    before = _told(asked, locked, {}, tell)
    return Residual(
        alone=_mean(before.alone),
        bound=_mean(before.corrected),
        absorption=(
            _absorption(before, _told(asked, locked, settings, tell)) if settings else None
        ),
    )


def _told(
    asked: Sequence[Subject],
    locked: Sequence[Subject],
    settings: Mapping[str, Value],
    tell: progress.Progress,
) -> _Told:
    examples = [_example(one, settings) for one in tell([*asked, *locked], "holes simulated")]
    learnt_from, held = examples[: len(asked)], examples[len(asked) :]
    with tempfile.TemporaryDirectory() as folder:
        predictor = registry.method(_METHOD).fit(
            learnt_from, folder=Path(folder), seed=_SEED, tell=tell
        )
    found = _Told([], [])
    for one in held:
        assert one.physics is not None
        known = known_holes(one)
        found.alone.append(holes.figures(physics_probability(one.physics), *known))
        found.corrected.append(holes.figures(predictor.probability(one), *known))
    return found


def _example(of: Subject, settings: Mapping[str, Value]) -> Example:
    depth_px, ground = of.real.depth_px, of.ground
    if depth_px is None:
        rule = "must have depth of its own or an infrared pair"
        raise refuse(f"scene {of.name}", rule, "neither", "Leave it out.")
    info = ground.info
    return Example(
        scene=of.name,
        room=of.room,
        info=info,
        depth_m=depth_from_disparity(
            ground.disparity_px, focal_px=info.fx_px, baseline_m=info.baseline_m
        ),
        ndp=~np.isfinite(depth_px[0]),
        counted=ground.counted,
        physics=of.physics(settings, seeds=range(DRAWS)),
    )


def _mean(scenes: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each figure over the scenes that have it; NaN where none has."""
    found = {}
    for name in scenes[0]:
        known = [one[name] for one in scenes if np.isfinite(one[name])]
        found[name] = float(np.mean(known)) if known else float("nan")
    return found


def _absorption(before: _Told, after: _Told) -> Absorption:
    nothing = [{_GAIN: 0.0}] * len(before.gains)
    gain = closed(before.gains, after.gains, nothing)[_GAIN]
    return Absorption(
        gain_before=gain.before,
        gain_after=gain.after,
        share=None if gain.closed_pct is None else gain.closed_pct / 100,
        interval=(
            None if gain.interval is None else (gain.interval[0] / 100, gain.interval[1] / 100)
        ),
    )
