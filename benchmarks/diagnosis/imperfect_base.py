r"""Diagnose development cases whose base is imperfect, and score effects and surrogates.

The second camera implementation captures eight development scenes. Its lens spot has a halo that
the base lacks, and its ambient light is occluded in corners. Both stay unknown to the diagnosis.
`--perfect` leaves both away. WORK caches light, captures, simulations and verdicts.

Usage:
    python benchmarks/diagnosis/imperfect_base.py --work WORK [--perfect] [--cases N]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.diagnosis.validation.adapters import light_sets
from starling.diagnosis.validation.adapters.cameras import builtin_camera
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.imperfections import OCCLUDED_SKY, TAILED_SPOT
from starling.diagnosis.validation.protocol import limits, programs, shoot
from starling.diagnosis.validation.protocol.case import Case, CaseKind, draw
from starling.sim import effects

SCENES = tuple(
    f"tabletop:{n}" if n % 4 == 3 else f"clutter:{n}" for n in range(7110, 7118)
)  # Development scenes.
SIZE = (320, 180)  # Width and height [px].
FRAMES = 2  # Frames per scene.
ENTROPY = 59  # Seed of the drawn cases.
COUNTS: dict[CaseKind, int] = {"null": 10, "single": 24, "pair": 8, "unknown": 10}
IMPERFECTIONS = {OCCLUDED_SKY: 0.15, TAILED_SPOT: 0.2}  # Reach [m] and share of the halo.

Effects = dict[str, Any]  # Reported effects of a verdict by row of the table.


def main() -> None:
    """Diagnose all cases and print the scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--perfect", action="store_true")
    parser.add_argument("--cases", type=int, help="number of cases; default: all")
    options = parser.parse_args()
    name = "perfect" if options.perfect else "imperfect"
    light = make_light(options.work)
    believed = nominal.read(light / nominal.FILE)
    cases = draw_cases(believed, {} if options.perfect else IMPERFECTIONS)[: options.cases]
    folder = options.work / name
    make_captures(folder / "cases", light, cases)
    sensor = options.work / "light" / programs.SENSOR
    programs.diagnose(folder / "cases", folder / "verdicts", sensor, options.work / "cache")
    verdicts = [
        json.loads((folder / "verdicts" / f"{case.name}.json").read_text()) for case in cases
    ]
    for case, verdict in zip(cases, verdicts, strict=True):
        print(line(case, verdict))
    for rule, reported in (("present", reported_effects), ("earlier", reported_by_earlier_rule)):
        result = scores(cases, [reported(verdict) for verdict in verdicts], believed)
        print(f"By the {rule} rule: {json.dumps(result, indent=1)}")


def make_light(work: Path) -> Path:
    """Render the scenes once."""
    light = work / "light"
    if not light.exists():
        light_sets.write(light, SCENES, builtin_camera(*SIZE))
    return light


def draw_cases(believed: nominal.Nominal, imperfections: Mapping[str, float]) -> tuple[Case, ...]:
    """Draw the cases, all with the same imperfections of the base."""
    cases = draw(
        believed,
        COUNTS,
        families={effect.name: effect.family for effect in effects.table()},
        limits=limits.read(),
        kinds=("image", "post"),
        entropy=ENTROPY,
    )
    return tuple(dataclasses.replace(case, imperfections=imperfections) for case in cases)


def make_captures(folder: Path, light: Path, cases: Sequence[Case]) -> None:
    """Capture the cases, with depth by our matcher."""
    camera = nominal.read(light / nominal.FILE)
    missing = [case for case in cases if not (folder / case.name).exists()]
    if not missing:
        return
    temporary = folder.with_name("part")
    shutil.rmtree(temporary, ignore_errors=True)
    for case in missing:
        shoot.shoot(light, case, temporary / case.name, frames=FRAMES)
    programs.run("own_depth", temporary, flags={"--sensor": light / programs.SENSOR})
    folder.mkdir(parents=True, exist_ok=True)
    for case in missing:
        shoot.postprocess(temporary / case.name, case, camera)
        (temporary / case.name).rename(folder / case.name)


def line(case: Case, verdict: Mapping[str, Any]) -> str:
    """Write a case and its verdict as a line."""
    listed = ", ".join(
        f"{'(' if effect['stand_in'] else ''}{effect['name']}="
        f"{_short(effect['parameters'][effect['name']])} gain {effect['gain']:.0f}"
        f"{')' if effect['stand_in'] else ''}"
        for effect in verdict["effects"]
    )
    true = ", ".join(f"{name}={_short(value)}" for name, value in case.settings.items())
    return f"{case.name} {case.kind:8} true {true or 'none'}; {verdict['verdict']}: {listed}"


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def reported_effects(verdict: Mapping[str, Any]) -> Effects:
    """Return the accepted effects that are no surrogates."""
    accepted = verdict["effects"]
    return {each["name"].partition(".")[0]: each for each in accepted if not each["stand_in"]}


def reported_by_earlier_rule(verdict: Mapping[str, Any]) -> Effects:
    """Return all accepted effects, or none if a gap stays unexplained in any segment."""
    if any(part["beyond"] > part["below"] for part in verdict["left"].values()):
        return {}
    return {each["name"].partition(".")[0]: each for each in verdict["effects"]}


def scores(
    cases: Sequence[Case], reported: Sequence[Effects], believed: nominal.Nominal
) -> dict[str, float]:
    """Score reported effects by kind of case."""
    pairs = list(zip(cases, reported, strict=True))
    known = [(case, names) for case, names in pairs if case.kind in ("single", "pair")]
    right = [name in names for case, names in known for name in case.settings]
    in_sets = [
        any(name in {part.partition(".")[0] for part in each["set"]} for each in names.values())
        for case, names in known
        for name in case.settings
    ]
    wrong = [any(name not in case.settings for name in names) for case, names in pairs]
    errors = [
        error
        for case, names in known
        for name, true in case.settings.items()
        if name in names and (error := _error_pct(names[name], true, believed)) is not None
    ]
    return {
        "right effects reported": float(np.mean(right)),
        "right effects in a set": float(np.mean(in_sets)),
        "cases with a wrong effect": float(np.mean(wrong)),
        "nulls with an effect": float(
            np.mean([bool(names) for case, names in pairs if case.kind == "null"])
        ),
        "unknowns with an effect": float(
            np.mean([bool(names) for case, names in pairs if case.kind == "unknown"])
        ),
        "median error of the strength [%]": float(np.median(errors)),
    }


def _error_pct(effect: Mapping[str, Any], true: float, believed: nominal.Nominal) -> float | None:
    row, value = ROWS[effect["name"].partition(".")[0]], effect["parameters"][effect["name"]]
    if row.scale == "choice":
        return None
    if effect["name"] != row.name or isinstance(value, str):
        return 100.0
    departure = row.departure(believed, true)
    return 100 * abs(row.departure(believed, value) - departure) / departure


if __name__ == "__main__":
    main()
