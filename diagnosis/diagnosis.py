"""The whole diagnosis of one capture set: where the gap lies and which effects made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from diagnosis import null, search, signature
from diagnosis.candidates import Arm, candidates
from diagnosis.fit import folds
from diagnosis.search import Accepted, Search
from diagnosis.signature import Bench
from diagnosis.subject import Subject, subject
from diagnosis.where import swap, table
from diagnosis.where.swap import Part
from diagnosis.where.table import Row
from patterns.errors import refuse
from sim import progress
from sim.capture import CaptureSet
from sim.sensor import Sensor

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]

EXPLAINED = 0.9  # Share of a gap below which something else is at work.
FEWEST = 2  # Scenes below which nothing can be held out.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ArmFound:
    """What one half of the stage swap says."""

    arm: Arm
    bench: Bench
    search: Search
    chance: float  # Size of the gap (as `Search.before`) that seeds alone make, 95 % of them.

    @property
    def gap(self) -> bool:
        """Whether there is more than chance makes."""
        return bool(self.search.accepted) or self.search.before > self.chance

    @property
    def unexplained(self) -> bool:
        """Whether the accepted effects leave much."""
        return self.search.after > self.chance and self.search.explained < EXPLAINED


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Diagnosis:
    """Answers of one run."""

    kind: Kind
    scenes: tuple[str, ...]
    parts: dict[str, Part]
    rows: tuple[Row, ...]
    arms: tuple[ArmFound, ...]

    @property
    def accepted(self) -> tuple[Accepted, ...]:
        """Effects of both arms."""
        return tuple(one for arm in self.arms for one in arm.search.accepted)


def diagnose(
    captures: CaptureSet,
    sensor: Sensor,
    *,
    cache: Path | None = None,
    tell: progress.Progress = progress.silent,
) -> Diagnosis:
    """Diagnose the gap between a capture set and a sensor that should be its camera's.

    Args:
        captures: scenes with reference depth or known geometry.
        sensor: the base: a preset or a calibrated sensor, with the captures' geometry.
        cache: folder that keeps what effects do to these scenes.
        tell: wraps loops that take long.

    Raises:
        InputError: if a scene is damaged, or none has geometry or reference depth.
    """
    subjects = [subject(scene, sensor) for scene in tell(captures.scenes, "scenes")]
    if not subjects:
        raise refuse("captures", "must hold a scene", 0, "Take captures first.")
    simulated = [one.simulate({}, seed=0) for one in subjects]
    real, grounds = [one.real for one in subjects], [one.ground for one in subjects]
    parts = swap.swap(simulated, real, grounds)
    first = [~np.isfinite(one.ours_px[0]) for one in simulated if one.ours_px is not None]
    device = [one.device_px if one.device_px is not None else one.ours_px for one in real]
    rows = table.table(first, [~np.isfinite(one[0]) for one in device if one is not None], grounds)
    arms = [
        _arm(arm, subjects, sensor, cache, tell)
        for arm in Arm
        if _has(arm, subjects) and len(subjects) >= FEWEST
    ]
    return Diagnosis(
        kind=_kind(arms),
        scenes=tuple(one.name for one in subjects),
        parts=parts,
        rows=tuple(rows),
        arms=tuple(arms),
    )


def _has(arm: Arm, subjects: Sequence[Subject]) -> bool:
    """Whether captures hold what an arm compares."""
    paired = all(one.real.left is not None for one in subjects)
    if arm is Arm.IMAGE:
        return paired
    return paired and all(one.real.device_px is not None for one in subjects)


def _arm(
    arm: Arm,
    subjects: Sequence[Subject],
    sensor: Sensor,
    cache: Path | None,
    tell: progress.Progress,
) -> ArmFound:
    bench = signature.bench(subjects, arm)
    base = null.base(bench)
    known = candidates(sensor, subjects[0].scene, arm)
    made = [
        signature.signature(one, bench, base.tables[0], cache=cache)
        for one in tell(known, f"effects of the {arm.value}")
    ]
    signatures = [one for one in made if one is not None]
    held = folds(len(subjects))
    gains = null.gains(base, signatures, held)
    found = search.search(bench, base, signatures, held, threshold=null.threshold(gains))
    return ArmFound(arm=arm, bench=bench, search=found, chance=null.size_by_chance(base))


def _kind(arms: Sequence[ArmFound]) -> Kind:
    if not arms:
        return "cannot tell"
    if any(arm.unexplained for arm in arms):
        return "none of the known"
    if any(arm.search.accepted for arm in arms):
        return "effects"
    return "no gap"
