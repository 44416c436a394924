"""One scene as it was captured and as it is simulated before and after, for a report to show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.scenes.strata import Ground
from starling.sim.effects.effect import Value

_SEED = 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shown:
    """Readings of one scene."""

    scene: str
    real: Reading
    before: Reading  # Simulated with the base, or the capture that this one is compared with.
    after: Reading | None  # Simulated with effects; None without any.
    ground: Ground


def shown(of: Subject, settings: Mapping[str, Value]) -> Shown:
    """Simulate a scene before and after, with common noise; of two captures nothing is simulated.

    Args:
        of: the scene.
        settings: value by effect; none: nothing is simulated after.
    """
    if of.against is not None:
        before, after = of.against, None
    else:
        before = of.like_captured({}, seed=_SEED)
        after = of.like_captured(settings, seed=_SEED) if settings else None
    return Shown(scene=of.name, real=of.real, before=before, after=after, ground=of.ground)
