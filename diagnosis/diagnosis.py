"""The whole diagnosis of one capture set: where the gap lies, what made it, how far it closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from diagnosis.crew import Crew
from diagnosis.howfar.judged import Judged, judged
from diagnosis.report.shown import Shown, shown
from diagnosis.subject import Subject, subject
from diagnosis.tell_apart import Told, tell_apart
from diagnosis.where import where
from diagnosis.where.where import Where
from diagnosis.which.arm import Found, diagnosed
from diagnosis.which.bench import bench
from diagnosis.which.candidates import Arm, candidates
from patterns.errors import refuse
from sim import progress
from sim.capture import CaptureSet
from sim.effects.effect import Value
from sim.sensor import Sensor

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]

LOCKED = 4  # One room in so many has no say in what is named.
FEWEST = 2  # Rooms below which nothing can be held out.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Diagnosis:
    """Answers of one run."""

    kind: Kind
    scenes: tuple[str, ...]
    locked: tuple[str, ...]  # Those of the scenes that only tell how far.
    limits: tuple[str, ...]  # What these captures cannot tell, a sentence each.
    where: Where
    arms: tuple[Found, ...]
    tell_apart: tuple[Told, ...]  # The best capture for each pair of rivals.
    howfar: Judged | None  # None where no scene is locked or nothing is named.
    shown: Shown  # A scene that pictures are made of, a locked one where there is any.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect, both arms'."""
        return {name: value for arm in self.arms for name, value in arm.settings.items()}


def diagnose(
    captures: CaptureSet,
    sensor: Sensor,
    *,
    cache: Path | None = None,
    families: Sequence[str] | None = None,
    tell: progress.Progress = progress.silent,
) -> Diagnosis:
    """Diagnose the gap between a capture set and a sensor that should be its camera's.

    Args:
        captures: scenes with reference depth or known geometry.
        sensor: the base: a preset or a calibrated sensor, with the captures' geometry.
        cache: folder that keeps what effects do to these scenes.
        families: of effects that are tried; None tries all.
        tell: wraps loops that take long.

    Raises:
        InputError: if a scene is damaged, or none has geometry or reference depth.
    """
    subjects = [subject(scene, sensor) for scene in tell(captures.scenes, "scenes")]
    if not subjects:
        raise refuse("captures", "must hold a scene", 0, "Take captures first.")
    locked = _locked([one.room for one in subjects])
    asked = [one for one, held in zip(subjects, locked, strict=True) if not held]
    kept = [one for one, held in zip(subjects, locked, strict=True) if held]
    with Crew(captures.path, sensor, [one.name for one in asked]) as crew:
        arms = [
            diagnosed(
                bench(asked, arm, cache=cache, crew=crew),
                [
                    one
                    for one in candidates(sensor, asked[0].scene, arm)
                    if families is None or one.effect.family in families
                ],
                tell=tell,
            )
            for arm in Arm
            if _has(arm, asked) and len({one.room for one in asked}) >= FEWEST
        ]
    settings = {name: value for arm in arms for name, value in arm.settings.items()}
    howfar = judged(kept, settings, arms) if kept and settings else None
    return Diagnosis(
        kind=_kind(arms),
        scenes=tuple(one.name for one in subjects),
        locked=tuple(one.name for one in kept),
        limits=tuple(_limits(subjects, kept)),
        where=where.where(subjects),
        arms=tuple(arms),
        tell_apart=tuple(_told(arms, asked, tell)),
        howfar=howfar,
        shown=shown((kept or subjects)[0], settings),
    )


def _locked(rooms: Sequence[str]) -> list[bool]:
    """Mark one room in four, by lot; none where fewer than four are there."""
    names = sorted(set(rooms))
    order = np.random.default_rng(0).permutation(len(names))
    held = {names[number] for number in order[: len(names) // LOCKED]}
    return [room in held for room in rooms]


def _has(arm: Arm, subjects: Sequence[Subject]) -> bool:
    """Whether captures hold what an arm compares."""
    paired = all(one.real.left is not None for one in subjects)
    measured = all(one.real.device_px is not None for one in subjects)
    return {Arm.IMAGE: paired, Arm.DEPTH: paired and measured, Arm.WHOLE: measured and not paired}[
        arm
    ]


def _kind(arms: Sequence[Found]) -> Kind:
    if not arms:
        return "cannot tell"
    if any(arm.unexplained for arm in arms):
        return "none of the known"
    if any(arm.search.accepted for arm in arms):
        return "effects"
    return "no gap"


def _limits(subjects: Sequence[Subject], kept: Sequence[Subject]) -> list[str]:
    found = []
    rooms = {one.room for one in subjects}
    if len(rooms) < FEWEST:
        found.append("One room alone: nothing can be held out, so no effect is named.")
    elif not kept:
        found.append(f"Fewer than {LOCKED} rooms: how far the gap closes is not judged.")
    if any(one.real.left is None for one in subjects):
        found.append("No infrared: what images do cannot be told from what matcher and filters do.")
    elif any(one.real.device_px is None for one in subjects):
        found.append("No depth of the device's own: its matcher and filters are not judged.")
    if any(one.frames < 2 for one in subjects):
        found.append("One frame a scene: noise in time is not seen.")
    return found


def _told(
    arms: Sequence[Found], subjects: Sequence[Subject], tell: progress.Progress
) -> list[Told]:
    """The best capture for every accepted effect and the first of its rivals."""
    pairs: list[tuple[Mapping[str, Value], Mapping[str, Value], Arm]] = []
    for arm in arms:
        for one in arm.search.accepted:
            rest = {k: v for k, v in arm.settings.items() if k != one.fit.name}
            pairs += [
                (
                    rest | {one.fit.name: one.fit.value},
                    rest | {rival.name: rival.value},
                    arm.bench.arm,
                )
                for rival in one.rivals[:1]
            ]
    found = []
    for first, second, arm in tell(pairs, "captures that would tell"):
        told = tell_apart(first, second, subjects[0], arm)
        found += told[:1]
    return found
