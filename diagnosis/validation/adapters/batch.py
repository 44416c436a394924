"""Diagnosis of many capture sets of the same scenes, which is given nothing but these.

    python -m starling.diagnosis.validation.adapters.batch CASES OUT --sensor FILE [--against SET] [--cache FOLDER]
                                                      [--without FILE]

CASES holds capture sets in folders of their own; OUT gets a verdict FOLDER.json for each, or two in
`without family` and `without twins` where an effect is not to be tried. Verdicts that are there
stay, so a run that was stopped goes on where it was. What effects do to the scenes is simulated
once for all. `starling diagnose` says more of one capture set.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.diagnosis.report import figures
from starling.diagnosis.scenes.observation import Reading, read
from starling.diagnosis.scenes.pairs import scene_pairs
from starling.diagnosis.scenes.scene_model import Subject, retaken, subject
from starling.diagnosis.validation.adapters import families, program
from starling.diagnosis.which import attribution, baselines
from starling.diagnosis.which import segment as arms
from starling.diagnosis.which.attribution import Named
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.segment import Found, Screen
from starling.diagnosis.which.table import Bench
from starling.patterns.errors import refuse
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import output, progress, record
from starling.sim.console.threads import single_threaded
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

Kept = dict[Arm, tuple[Bench, Screen]]


def diagnose(
    cases: Path,
    out: Path,
    sensor: Sensor,
    *,
    against: CaptureSet | None = None,
    cache: Path | None = None,
    without: dict[str, str] | None = None,
    track: progress.Progress = progress.silent,
) -> None:
    """Write a verdict for every capture set that has none yet.

    Args:
        cases: folder of capture sets of the same scenes.
        out: folder of verdicts, or of both folders of them; made where there is none.
        sensor: that all of them should be captures of.
        against: capture set that each is compared with in place of simulated captures.
        cache: folder that keeps what is simulated, for other runs.
        without: by capture set an effect whose family is not to be tried, and in a second verdict
            nor those of effects that it is confused with, as the table says; then only the capture
            sets named here are diagnosed.
        track: wraps the loop over capture sets.

    Raises:
        InputError: if there is no capture set, one is damaged or shows other scenes than the first,
            neither its scenes are known nor what they are compared with, or an effect is not known.
    """
    folders = program.capture_sets(cases)
    if without is not None:
        folders = [folder for folder in folders if folder.name in without]
    todo = [folder for folder in folders if _missing(out, folder.name, without)]
    others = {} if against is None else {one.name: read(one, sensor) for one in against.scenes}
    subjects: list[Subject] = []
    kept: Kept = {}
    for folder in track(todo, "capture sets"):
        begun = time.perf_counter()
        pairs = scene_pairs(capture.open_set(folder), against).pairs
        subjects = _subjects(folder.name, pairs, sensor, subjects, others)
        asked, locked = attribution.parted(subjects)
        screens = [
            _screened(arm, asked, kept, cache, track)
            for arm in attribution.open_arms(subjects, asked)
        ]
        for path, tried in _missing(out, folder.name, without).items():
            part = [(table, arms.of_families(screen, tried)) for table, screen in screens]
            told = _told(attribution.named(part, locked), seed=scene_seed(0, folder.name))
            told["seconds"] = round(time.perf_counter() - begun, 3)
            output.write_file(path, record.dumps(told).encode())
            begun = time.perf_counter()


def _missing(out: Path, case: str, without: Mapping[str, str] | None) -> dict[Path, frozenset[str]]:
    """Verdicts that a capture set has not yet, and the families that are tried for each."""
    every = frozenset(families.known())
    tables = {out: every}
    if without is not None:
        gone = effects.named(without[case])
        alike = {effects.named(name).family for name in families.twins(gone)}
        rest = every - {gone.family}
        tables = {out / "without family": rest, out / "without twins": rest - alike}
    paths = {folder / f"{case}.json": tried for folder, tried in tables.items()}
    return {path: tried for path, tried in paths.items() if not path.exists()}


def _screened(
    arm: Arm,
    asked: Sequence[Subject],
    kept: Kept,
    cache: Path | None,
    track: progress.Progress,
) -> tuple[Bench, Screen]:
    """Screen an arm once for all capture sets; what is matched again is each one's own."""
    if arm is Arm.DEPTH:
        return attribution.screened(arm, asked)
    if arm not in kept:
        kept[arm] = attribution.screened(arm, asked, cache=cache, track=track)
    table, screen = kept[arm]
    return table.of(asked), screen


def _told(found: Named, *, seed: int) -> dict[str, Any]:
    """A verdict as its file has it."""
    return {
        "verdict": found.kind,
        "effects": sorted(figures.effects(found.arms), key=lambda one: -one["gain"]),
        "left": {
            arm.bench.arm.value: {
                "before": arm.sizes[0],
                "after": arm.sizes[1],
                "beyond": arm.beyond,
                "below": arm.explained_below,
            }
            for arm in found.arms
        },
        "howfar": figures.howfar(found.howfar),
        "versions": record.versions(),
        "baselines": _baselines(found.arms, seed=seed),
        "baselines_by_arm": {
            arm.bench.arm.value: _baselines([arm], seed=seed) for arm in found.arms
        },
    }


def _subjects(
    case: str,
    pairs: Sequence[tuple[CapturedScene, CapturedScene | None]],
    sensor: Sensor,
    before: Sequence[Subject],
    others: Mapping[str, Reading],
) -> list[Subject]:
    """Scenes of a capture set; what is known of them is taken over from the one before."""
    if not before:
        made = [subject(one, sensor, against=other) for one, other in pairs]
        told = [one.name for one in made if one.estimates and one.against is None]
        if told:  # By the first set, which would be another's where a run goes on.
            rule = "must have a scene.toml each, or others that they are compared with"
            raise refuse("scenes", rule, told, "Give either.")
        return made
    names, known = [one.name for one, _ in pairs], [one.name for one in before]
    if names != known:
        raise refuse("scenes", "must be the same in all capture sets", (case, names), "Part it.")
    taken = [
        retaken(one, scene, against=others.get(one.name))
        for one, (scene, _) in zip(before, pairs, strict=True)
    ]
    repeats, known = [one.frames for one in taken], [one.frames for one in before]
    if repeats != known:
        told = (case, repeats)
        raise refuse("repeats", "must be as many in all capture sets", told, f"Give {known}.")
    return taken


def _baselines(arms: Sequence[Found], *, seed: int) -> dict[str, str | None]:
    """What simpler ways name."""
    each = [(arm.screen.rough, arm.likelihood) for arm in arms]
    return {
        "largest_drop": baselines.largest_drop(each),
        "cosine": baselines.nearest(each),
        "random": baselines.by_lot(each, seed=seed),
    }


def _left_out(path: Path) -> dict[str, str]:
    """By capture set an effect, as a file tells it."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise refuse("without", "must be a readable JSON file", path, f"{error}.") from error
    if not isinstance(told, dict):
        raise refuse("without", "must be an object", told, "Give an effect by capture set.")
    return told


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where something is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.batch",
        description="Diagnose many capture sets of the same scenes.",
    )
    parser.add_argument("cases", type=Path, help="folder of capture sets")
    parser.add_argument("out", type=Path, help="folder for a verdict FOLDER.json of each")
    parser.add_argument("--sensor", required=True, help="preset or sensor file of all of them")
    parser.add_argument("--against", type=Path, help="capture set to compare each with")
    parser.add_argument("--cache", type=Path, help="folder that keeps what is simulated")
    parser.add_argument(
        "--without",
        type=Path,
        help="JSON file: by capture set an effect whose family is not to be tried; others wait",
    )
    asked = parser.parse_args(arguments)
    single_threaded()
    return program.run(
        lambda track: diagnose(
            asked.cases,
            asked.out,
            resolve.load(asked.sensor, captures=str(program.capture_sets(asked.cases)[0])),
            against=None if asked.against is None else capture.open_set(asked.against),
            cache=asked.cache,
            without=None if asked.without is None else _left_out(asked.without),
            track=track,
        )
    )


if __name__ == "__main__":
    sys.exit(main())
