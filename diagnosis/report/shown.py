"""One scene as it was captured and as it is simulated before and after, for a report to show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from diagnosis.ground import Ground
from diagnosis.reading import Reading
from diagnosis.subject import Subject
from patterns.errors import InputError
from sim.effects.effect import Value

_SEED = 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shown:
    """Readings of one scene."""

    scene: str
    real: Reading
    before: Reading  # Simulated with the base.
    after: Reading | None  # With the accepted effects; None without any, or where they exclude.
    ground: Ground


def shown(of: Subject, settings: Mapping[str, Value]) -> Shown:
    """Simulate a scene before and after, with common noise.

    Args:
        of: the scene.
        settings: value by accepted effect.
    """
    return Shown(
        scene=of.name,
        real=of.real,
        before=of.simulate({}, seed=_SEED),
        after=_after(of, settings),
        ground=of.ground,
    )


def _after(of: Subject, settings: Mapping[str, Value]) -> Reading | None:
    if not settings:
        return None
    try:
        return of.simulate(settings, seed=_SEED)
    except InputError:  # Effects that exclude each other in this sensor were only added up.
        return None
