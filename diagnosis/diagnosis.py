"""The whole diagnosis of one capture set: where the gap lies, what made it, how far it closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from starling.diagnosis.howfar.evaluation import Judged
from starling.diagnosis.howfar.residual import METHOD, Residual, learn
from starling.diagnosis.report.scene_images import Shown, shown
from starling.diagnosis.scenes.comparable import complete
from starling.diagnosis.scenes.estimated import TAKEN_UP
from starling.diagnosis.scenes.limits import limits_of
from starling.diagnosis.scenes.pairs import scene_pairs
from starling.diagnosis.scenes.scene_model import Subject, subject
from starling.diagnosis.validation.adapters.families import refuse_others
from starling.diagnosis.where import location as where
from starling.diagnosis.where.location import Where
from starling.diagnosis.which.attribution import Kind, named, open_arms, parted, screened, tried
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.discrimination import Told, tell_apart
from starling.diagnosis.which.segment import Found
from starling.diagnosis.which.sensitivity import Noticed, noticed
from starling.diagnosis.workers import Crew
from starling.learning import registry
from starling.patterns.errors import InputError, refuse
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Diagnosis:
    """Answers of one run."""

    kind: Kind
    against: str | None  # Capture set that this one is compared with; None: with simulation.
    scenes: tuple[str, ...]
    locked: tuple[str, ...]  # Those of the scenes that only tell how far.
    fitted: dict[str, dict[str, float]]  # By scene what was fitted to it, by effect.
    limits: tuple[str, ...]  # What these captures cannot tell, a sentence each.
    where: Where
    arms: tuple[Found, ...]
    settings: dict[str, Value]  # By accepted effect, all arms'.
    together: bool  # Whether one sensor can have all of them.
    taken_up: tuple[str, ...]  # Those that estimates of reflectance and light take up in part.
    tell_apart: tuple[Told, ...]  # The best capture for each accepted effect and its first rival.
    howfar: Judged | None  # None where no scene is locked or nothing is named.
    residual: Residual | None  # None where it was not asked for, or nothing could be learnt.
    noticed: tuple[Noticed, ...]  # Where there is no gap: what would have been one.
    shown: Shown  # A scene that pictures are made of, a locked one where there is any.


def diagnose(
    captures: CaptureSet,
    sensor: Sensor,
    *,
    against: CaptureSet | None = None,
    cache: Path | None = None,
    families: Sequence[str] | None = None,
    residual: bool = False,
    track: progress.Progress = progress.silent,
) -> Diagnosis:
    """Diagnose the gap between a capture set and a sensor, or another capture set of the scenes.

    Simulates in processes of its own: call it below `if __name__ == "__main__"` in a script.

    Args:
        captures: scenes with reference depth or known geometry.
        sensor: the base: a preset or a calibrated sensor, with the captures' geometry.
        against: capture set of the same scenes by the base, which is compared in place of
            simulated readings; only scenes that both have count.
        cache: folder that keeps what effects do to these scenes.
        families: of effects that are tried; None tries all.
        residual: learn what physics misses, as a bound and a witness (`howfar.residual`).
        track: wraps loops that take long.

    Raises:
        InputError: if a scene is damaged or has neither geometry nor reference depth, scenes are of
            several cameras, both sets differ in geometry or have nothing in common, a family is
            none, none of them acts on what was captured, a residual is asked for against another
            set or without torch, or the sensor is none of stereo.
    """
    refuse_others(families or ())
    if sensor.kind == "structured_light":
        rule = "must be a stereo camera's"
        raise refuse("sensor", rule, sensor.kind, "Structured light has no pair to compare.")
    if residual and against is not None:
        rule = "must be asked of a simulation, not of another capture set"
        raise refuse("residual", rule, against.path.name, "Leave one out.")
    learner = registry.method(METHOD) if residual else None
    scenes = scene_pairs(captures, against)
    read = [subject(one, sensor, against=other) for one, other in track(scenes.pairs, "scenes")]
    subjects, incomplete = complete(read)
    asked, locked = parted(subjects)
    arms = open_arms(subjects, asked)
    untried = [arm for arm in arms if not tried(arm, asked, families)]
    if arms and untried == arms:
        rule = "must have an effect that acts on what these captures hold"
        raise refuse("families", rule, " ".join(families or ()), "Name others, or none.")
    told = where.where(subjects)
    other = None if against is None else against.path
    with Crew(captures.path, sensor, asked, aside=locked, against=other) as crew:
        screens = [
            screened(arm, asked, families=families, cache=cache, crew=crew, track=track)
            for arm in arms
        ]
        found = named(screens, locked, track=track)
        proposed = _told(found.arms, asked, crew, track)
    seen = [
        one for _, screen in (screens if found.kind == "no gap" else ()) for one in noticed(screen)
    ]
    learnt = None
    limits = limits_of(
        (captures if against is None else against).info.sensor,
        subjects,
        locked=bool(locked),
        aside=scenes.aside,
        incomplete=[one.name for one in incomplete],
        families=families,
        untried=untried,
    )
    if not found.together:
        limits.append(
            "Effects named of images and of depth exclude each other in one sensor: how far the "
            "gap closes is not judged, and no sensor has them all."
        )
    if learner is not None:
        try:
            learnt = learn(
                learner, asked, locked, found.settings if found.together else {}, track=track
            )
        except InputError as error:  # What was found without it is told all the same.
            limits.append(f"No residual was learnt: {error}")
    return Diagnosis(
        kind=found.kind,
        against=None if other is None else str(other),
        scenes=tuple(one.name for one in subjects),
        locked=tuple(one.name for one in locked),
        fitted={
            one.name: {name: each.own for name, each in one.nuisances.items()} for one in subjects
        },
        limits=tuple(limits),
        where=told,
        arms=found.arms,
        settings=found.settings,
        together=found.together,
        taken_up=_taken_up(found.settings, subjects),
        tell_apart=tuple(proposed),
        howfar=found.howfar,
        residual=learnt,
        noticed=tuple(seen),
        shown=shown((locked or subjects)[0], found.settings if found.together else {}),
    )


def _taken_up(settings: Mapping[str, Value], subjects: Sequence[Subject]) -> tuple[str, ...]:
    if not any(one.estimates and one.against is None for one in subjects):
        return ()
    return tuple(name for name in settings if setting.parameter_of(name)[0].family in TAKEN_UP)


def _told(
    arms: Sequence[Found], subjects: Sequence[Subject], crew: Crew, track: progress.Progress
) -> list[Told]:
    """For every accepted effect and the first of its rivals the capture that tells them apart and
    tells most for its effort; where none does, the one that tells most.
    """
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
    # Each of another scene, as the next is held by another process.
    asked = [
        crew.submit(subjects[number % len(subjects)].name, tell_apart, *pair)
        for number, pair in enumerate(pairs)
    ]
    found = []
    for one in track(asked, "captures that would tell"):
        told = one.result()
        most = max(told, key=lambda one: one.deviations, default=None)
        best = next((one for one in told if one.enough), most)
        found += [] if best is None else [best]
    return found
