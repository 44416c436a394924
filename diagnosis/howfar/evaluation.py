"""How far the gap closes on scenes that had no say in what was named."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from starling.diagnosis.howfar.distances import distances
from starling.diagnosis.howfar.reduction import Closed, closed
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which import null
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.segment import Found
from starling.diagnosis.which.table import Bench
from starling.sim.console import progress
from starling.sim.effects.effect import Value

Settings = Mapping[str, Value]

DRAWS = 4  # Seeds of a simulated reading.
OTHER = 100  # Device, and seed, of what stands for the real capture.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Judged:
    """Answers to the third question."""

    figures: dict[str, Closed]
    # By effect, of what is closed in its arm's features (Shapley): sum 1 in each arm; none of
    # effects of which some can only be set together.
    shares: dict[str, float]


def judged(
    locked: Sequence[Subject],
    settings: Settings,
    arms: Sequence[Found],
    *,
    track: progress.Progress = progress.silent,
) -> Judged:
    """Measure the gap of locked scenes before and after, and what noise alone makes.

    Distances are of simulated readings from real ones; two captures that are compared have none.
    Beside every distance stands `features of the ARM`: the size of the gap in all that the
    diagnosis looks at.

    Args:
        locked: scenes that told nothing of which.
        settings: value by accepted effect.
        arms: whose features are looked at.
        track: wraps loops that take long.
    """
    each = [_figures(one, settings) for one in track(locked, "locked scenes")]
    before, after, floor = ([figures[part] for figures in each] for part in range(3))
    shares: dict[str, float] = {}
    for arm in arms:
        table, likelihood, other = _likelihoods(arm, locked)
        made = _made(table, arm.settings) if arm.settings else likelihood.nothing
        name = f"features of the {arm.bench.arm.value}"
        for many, of, by in (
            (before, likelihood, likelihood.nothing),
            (after, likelihood, made),
            (floor, other, made),
        ):
            for row, size in zip(many, of.sizes(by), strict=True):
                row[name] = float(size)
        shares |= _shares(arm, table, likelihood)
    return Judged(figures=closed(before, after, floor, [one.room for one in locked]), shares=shares)


def _figures(of: Subject, settings: Settings) -> tuple[dict[str, float], ...]:
    """Distances before, after and floor of one scene."""
    if of.against is not None:
        return {}, {}, {}
    before, after = (
        [of.like_captured(one, seed=seed) for seed in range(DRAWS)] for one in ({}, settings)
    )
    other = of.another(OTHER).like_captured(settings, seed=OTHER)
    return (
        distances(of.real, before, of.ground),
        distances(of.real, after, of.ground),
        distances(other, after, of.ground),
    )


def _likelihoods(arm: Found, locked: Sequence[Subject]) -> tuple[Bench, Likelihood, Likelihood]:
    """The locked scenes' features: of the real readings, and of simulated ones in their place."""
    table = dataclasses.replace(arm.bench, subjects=tuple(locked), _kept={}, _begun={})
    base, weight = null.base(table), arm.screen.weight
    made = null.another(table, base, arm.settings, number=OTHER)
    assert made is not None  # As they were accepted together.
    beside, other = made
    return table, base.likelihood(table.real(), weight), beside.likelihood(other, weight)


def _made(table: Bench, settings: Settings) -> Made:
    change = table.change(settings)
    assert change is not None  # Those that exclude each other are not accepted together.
    return Made(change)


def _shares(arm: Found, table: Bench, likelihood: Likelihood) -> dict[str, float]:
    """Shapley values of the accepted effects over what they close together.

    Source: Shapley, A value for n-person games (1953), eq. 13.
    """
    names = tuple(arm.settings)
    closed_by: dict[tuple[str, ...], float] = {(): 0.0}
    for count in range(1, len(names) + 1):
        for some in itertools.combinations(names, count):
            change = table.change({name: arm.settings[name] for name in some})
            if change is None:  # As a small penalty that is above the base's large one.
                return {}
            size = likelihood.size(Made(change))
            closed_by[some] = likelihood.size(likelihood.nothing) - size
    total = closed_by[names]
    if total <= 0:
        return {}
    return {name: _shapley(name, names, closed_by) / total for name in names}


def _shapley(
    name: str, names: tuple[str, ...], closed_by: Mapping[tuple[str, ...], float]
) -> float:
    others = [one for one in names if one != name]
    value = 0.0
    for count in range(len(others) + 1):
        weight = math.factorial(count) * math.factorial(len(others) - count)
        for some in itertools.combinations(others, count):
            with_it = tuple(one for one in names if one in some or one == name)
            value += weight * (closed_by[with_it] - closed_by[some])
    return value / math.factorial(len(names))
