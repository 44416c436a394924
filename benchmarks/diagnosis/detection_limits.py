"""Measure the detection limits of effects with the nominal camera of the validation.

Writes `diagnosis/validation/protocol/detection.json` from two sets of ten development scenes,
captured without any effect. A limit must hold in both sets
(`starling.diagnosis.validation.adapters detection`). WORK caches light and captures by the digest
of the code, and simulations by their inputs, so an interrupted run can continue. With --effects the
limits go to a separate file, so that no file mixes limits of two code versions.

With --imperfect it writes `detection_imperfect.json` from one set of eight scenes in the size of
tier 5. They are captured eight times without any effect, each with other imperfections of the base.
A limit must hold in half of them, for effects on the images.

Usage:
    python benchmarks/diagnosis/detection_limits.py --work WORK [--out FILE] [--effects NAME...]
    python benchmarks/diagnosis/detection_limits.py --work WORK --imperfect [--effects NAME...]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.adapters import cameras, detection, light_sets
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol import limits, plan, programs, seal, shoot
from starling.diagnosis.validation.protocol.case import Case, draw
from starling.diagnosis.validation.protocol.tier import TIERS, Tier
from starling.sim.sensor import presets

ROOT = Path(__file__).parents[2]
FIRST = (9300, 9310)  # First scene of each set; no case uses these scenes.
NULL = Case(number=0, kind="null", settings={}, seed=1)
FIRST_IMPERFECT = 7110  # First scene of the development set with an imperfect base.
WORLDS = 8  # Number of captures with an imperfect base.
ENTROPY = 64  # Seed of their imperfections.


def main() -> None:
    """Measure the limits and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--imperfect", action="store_true")
    parser.add_argument(
        "--effects", nargs="*", default=[], help="effects to measure, with --out; default: all"
    )
    options = parser.parse_args()
    default = limits.IMPERFECT_FILE if options.imperfect else limits.FILE
    out = options.out or default
    if options.effects and out.exists():
        rule = "must be a new file if effects are named"
        advice = "Give --out, or omit --effects."
        parser.error(str(refusal("out", rule, out, advice)))
    run = measure_imperfect if options.imperfect else measure
    limits_table = run(options.work, options.effects)
    lines = [f"{json.dumps(name)}: {json.dumps(limit)}" for name, limit in limits_table.items()]
    out.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def measure(work: Path, effects: list[str]) -> dict[str, Any]:
    """Measure the limits that hold in both sets, and record scenes and commit.

    Raises:
        WithheldError: if the code changes during the run.
    """
    code, commit = seal.code_digest(), describe_commit()
    set_limits = [measure_set(work, effects, code, first) for first in FIRST]
    if seal.code_digest() != code:
        advice = "Run it again; cached simulations are reused."
        raise refusal("code", "must not change during the run", "other code", advice)
    source = {"scenes": [tier_from(first).scene_names(0) for first in FIRST], "commit": commit}
    return {"made of": source, **detection.common_limits(set_limits)}


def measure_imperfect(work: Path, effects: list[str]) -> dict[str, Any]:
    """Measure the limits on the images despite an imperfect base.

    Args:
        work: Folder of cached files.
        effects: Effects to measure; empty for all.
    """
    tier = dataclasses.replace(TIERS[5], first_scene=FIRST_IMPERFECT)
    folder = work / f"imperfect-{seal.code_digest()[:16]}"
    light = make_light(folder, tier)
    believed = nominal.read(light / nominal.FILE)
    cases = draw(believed, {"null": WORLDS}, imperfect=plan.ALL, entropy=ENTROPY)
    captures = [folder / case.name for case in cases]
    for path, case in zip(captures, cases, strict=True):
        shutil.rmtree(path, ignore_errors=True)
        shoot.shoot(light, case, path, frames=tier.frames)
    measured = detection.limits_despite_gaps(
        captures,
        presets.load(str(light / programs.SENSOR)),
        wanted=effects or None,
        cache=work / "imperfect-cache",
    )
    source = {"scenes": tier.scene_names(0), "worlds": WORLDS, "commit": describe_commit()}
    return {"made of": source, **measured}


def make_light(folder: Path, tier: Tier) -> Path:
    """Render the first scene set of a tier once."""
    light = folder / "light"
    if not light.exists():
        sensor = cameras.builtin_camera(tier.width, tier.height)
        light_sets.write(light, tier.scene_names(0), sensor)
    return light


def describe_commit() -> str:
    """Return the commit of this repository, marked if there are uncommitted changes."""
    commit, changes = (
        subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()
        for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain"))
    )
    return f"{commit} with changes" if changes else commit


def tier_from(first: int) -> Tier:
    """Return tier 1 with another first scene."""
    return dataclasses.replace(TIERS[1], first_scene=first)


def measure_set(work: Path, effects: list[str], code: str, first: int) -> dict[str, Any]:
    """Measure the limits in one scene set.

    Args:
        work: Folder of cached files.
        effects: Effects to measure; empty for all.
        code: Digest of the code that makes light and captures.
        first: First scene of the set.
    """
    tier = tier_from(first)
    folder = work / str(first) / code[:16]
    light, captures = make_light(folder, tier), folder / "captures"
    if not captures.exists():
        temporary = captures.with_name(".captures")  # Renamed when complete.
        shutil.rmtree(temporary, ignore_errors=True)
        shoot.shoot(light, NULL, temporary / "null", frames=tier.frames)
        programs.run("own_depth", temporary, flags={"--sensor": light / programs.SENSOR})
        temporary.rename(captures)
    nominal_sensor = presets.load(str(light / programs.SENSOR))
    cache = work / str(first) / "cache"
    return detection.limits(captures / "null", nominal_sensor, wanted=effects or None, cache=cache)


if __name__ == "__main__":
    main()
