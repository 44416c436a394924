"""Which effects made a gap, in each half of the stage swap, and how far it closes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from starling.diagnosis.howfar.evaluation import Judged, judged
from starling.diagnosis.scenes import fit_scene, rooms
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which import segment as arms
from starling.diagnosis.which.candidates import Arm, Candidate, candidates
from starling.diagnosis.which.segment import Found, Screen
from starling.diagnosis.which.table import Bench, bench
from starling.diagnosis.workers import Crew
from starling.patterns.errors import InputError
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]

LOCKED = 4  # One room in so many has no say in what is named;
_SURE = 8  # from so many rooms on no fewer than tell how sure a mean is.
FEWEST = 2  # Rooms below which nothing can be held out.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Named:
    """Answers to the second and the third question."""

    kind: Kind
    arms: tuple[Found, ...]
    settings: dict[str, Value]  # By accepted effect, all arms'.
    together: bool  # Whether one sensor can have all of them.
    howfar: Judged | None  # None where no scene is locked, or nothing that can be set is named.


def parted(subjects: Sequence[Subject]) -> tuple[list[Subject], list[Subject]]:
    """Subjects that are asked, and those locked away to tell how far.

    One room in four is locked, by lot, and of eight rooms and more at least three; none where fewer
    than four are there.
    """
    names = sorted({one.room for one in subjects})
    order = np.random.default_rng(0).permutation(len(names))
    count = max(len(names) // LOCKED, rooms.FEWEST if len(names) >= _SURE else 0)
    held = {names[number] for number in order[:count]}
    asked = [one for one in subjects if one.room not in held]
    return asked, [one for one in subjects if one.room in held]


def open_arms(subjects: Sequence[Subject], asked: Sequence[Subject]) -> list[Arm]:
    """Arms that captures let ask about; none of one room, where nothing can be held out.

    Args:
        subjects: all of them, as what is named is judged on those that are locked.
        asked: those that are asked.
    """
    if len({one.room for one in asked}) < FEWEST:
        return []
    return [arm for arm in Arm if _has(arm, subjects)]


def screened(
    arm: Arm,
    asked: Sequence[Subject],
    *,
    families: Sequence[str] | None = None,
    always: bool = False,
    cache: Path | None = None,
    crew: Crew | None = None,
    track: progress.Progress = progress.silent,
) -> tuple[Bench, Screen]:
    """Simulate what may have acted in one arm.

    Args:
        arm: one that is open.
        asked: at least one subject.
        families: as `tried`.
        always: as `arms.screen`.
        cache: folder that keeps what is simulated, for other runs.
        crew: who simulates; None: this process.
        track: wraps loops that take long.
    """
    table = bench(asked, arm, cache=cache, crew=crew)
    return table, arms.screen(table, tried(arm, asked, families), always=always, track=track)


def tried(
    arm: Arm, asked: Sequence[Subject], families: Sequence[str] | None = None
) -> list[Candidate]:
    """List what is tried in one arm: all but what was fitted to a scene from the very captures that
    are diagnosed.

    Args:
        arm: one that is open.
        asked: at least one subject.
        families: of effects that are asked for; None asks for all.
    """
    first = asked[0]
    base = setting.apply(first.sensor, first.scene, fit_scene.commonly(first.nuisances))
    taken = {name for one in asked if one.against is None for name in one.nuisances}
    return [
        one
        for one in candidates(*base, arm)
        if (families is None or one.effect.family in families) and one.name not in taken
    ]


def named(
    screens: Sequence[tuple[Bench, Screen]],
    locked: Sequence[Subject],
    *,
    track: progress.Progress = progress.silent,
) -> Named:
    """Name effects, and judge them on locked scenes.

    Args:
        screens: of each arm.
        locked: subjects that had no say.
        track: wraps loops that take long.
    """
    found = tuple(arms.diagnosed(table, screen) for table, screen in track(screens, "search"))
    settings = {name: value for arm in found for name, value in arm.settings.items()}
    together = not settings or _settable(found[0].bench.subjects[0], settings)
    asked = locked and settings and together
    return Named(
        kind=_kind(found),
        arms=found,
        settings=settings,
        together=together,
        howfar=judged(locked, settings, found, track=track) if asked else None,
    )


def _settable(of: Subject, settings: dict[str, Value]) -> bool:
    try:
        setting.apply(of.sensor, of.scene, of.own(settings))
    except InputError:
        return False
    return True


def _has(arm: Arm, subjects: Sequence[Subject]) -> bool:
    """Whether captures hold what an arm compares."""
    paired = all(one.real.left is not None for one in subjects)
    measured = all(one.real.device_px is not None for one in subjects)
    return {Arm.IMAGE: paired, Arm.DEPTH: paired and measured, Arm.WHOLE: measured and not paired}[
        arm
    ]


def _kind(found: Sequence[Found]) -> Kind:
    if not found:
        return "cannot tell"
    if any(arm.unexplained for arm in found):
        return "none of the known"
    if any(arm.search.accepted for arm in found):
        return "effects"
    return "no gap"
