"""How strong effects have to be to be found, by the camera of the check on withheld effects.

Makes `diagnosis/validation/protocol/detection.json` anew: two sets of ten scenes of development, captured by
that camera without any effect. A limit has to hold in both (`starling.diagnosis.validation.adapters.detection`). A run that was
stopped goes on: WORK keeps light and captures by the code that made them, and what was simulated by
all that it follows from. Of some effects alone a file of its own is made: limits of two codes are
not to be in one.

Usage:
    python benchmarks/diagnosis/detection_limits.py --work WORK [--out FILE] [--effects NAME...]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.adapters import detection, light_sets
from starling.diagnosis.validation.adapters.check_camera import camera
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol import limits, programs, seal, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.tier import TIERS, Tier
from starling.sim.sensor import presets

ROOT = Path(__file__).parents[2]
FIRST = (9300, 9310)  # Scenes of each set, that no case was ever drawn on.
NULL = Case(number=0, kind="null", settings={}, seed=1)


def main() -> None:
    """Ask both sets, and write what holds in both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=limits.FILE)
    parser.add_argument(
        "--effects", nargs="*", default=[], help="that are asked about, with --out; all if none"
    )
    asked = parser.parse_args()
    if asked.effects and asked.out.exists():
        rule = "must be a new file where effects are named, whose limits alone it would hold"
        advice = "Give --out, or leave --effects away."
        parser.error(str(refusal("out", rule, asked.out, advice)))
    told = of_both(asked.work, asked.effects)
    asked.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def of_both(work: Path, effects: list[str]) -> dict[str, Any]:
    """Limits that hold in both sets, and what they are made of.

    Raises:
        WithheldError: if the code became another meanwhile.
    """
    code, commit = seal.code(), committed()
    each = [of_set(work, effects, code, first) for first in FIRST]
    if seal.code() != code:
        advice = "Run it again: what was simulated is kept."
        raise refusal("code", "must stay what it was at the start", "another", advice)
    made = {"scenes": [of_tier(first).names(0) for first in FIRST], "commit": commit}
    return {"made of": made, **detection.in_each(each)}


def committed() -> str:
    """Commit of this file's tree, and whether there are changes since."""
    commit, changes = (
        subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()
        for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain"))
    )
    return f"{commit} with changes" if changes else commit


def of_tier(first: int) -> Tier:
    """Tier 1, its first set being this one."""
    return dataclasses.replace(TIERS[1], first=first)


def of_set(work: Path, effects: list[str], code: str, first: int) -> dict[str, Any]:
    """Limits in one set of scenes.

    Args:
        work: keeps what is made.
        effects: that are asked about; all if none.
        code: fingerprint of what makes light and captures, which others cannot use.
        first: of the scenes.
    """
    tier = of_tier(first)
    made = work / str(first) / code[:16]
    light, captures = made / "light", made / "captures"
    sensor = camera(tier.width, tier.height)
    if not light.exists():
        light_sets.write(light, tier.names(0), sensor)
    if not captures.exists():
        aside = captures.with_name(".captures")  # Named last: what is half done is done again.
        shutil.rmtree(aside, ignore_errors=True)
        shoot.shoot(light, NULL, aside / "null", frames=tier.frames)
        programs.depth(aside, light / programs.SENSOR)
        aside.rename(captures)
    believed = presets.load(str(light / programs.SENSOR))
    cache = work / str(first) / "cache"
    return detection.limits(captures / "null", believed, wanted=effects or None, cache=cache)


if __name__ == "__main__":
    main()
