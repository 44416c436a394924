"""How strong effects have to be to be found, by the camera of the check on withheld effects.

Makes `diagnosis/withheld/detection.json` anew: two sets of ten scenes of development, captured by
that camera without any effect. A limit has to hold in both (`diagnosis.detection`). What was
simulated is kept in WORK: a run that was stopped goes on.

Usage:
    python benchmarks/detection_limits.py --work WORK [--out FILE] [--effects NAME...]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import subprocess
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from diagnosis import detection, light_sets
from diagnosis.check_camera import camera
from diagnosis.withheld import limits, programs, shoot
from diagnosis.withheld.case import Case
from diagnosis.withheld.tier import TIERS, Tier
from sim import sensors
from sim.threads import single_threaded

FIRST = (9300, 9310)  # Scenes of each set, that no case was ever drawn on.
NULL = Case(number=0, kind="null", settings={}, seed=1)


def main() -> None:
    """Ask both sets, each in a process, and write what holds in both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=limits.FILE)
    parser.add_argument(
        "--effects", nargs="*", default=[], help="that are asked about; all if none"
    )
    asked = parser.parse_args()
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    with ProcessPoolExecutor(len(FIRST)) as pool:
        each = list(pool.map(partial(of_set, asked.work, asked.effects), FIRST))
    made = {"scenes": [of_tier(first).names(0) for first in FIRST], "commit": commit}
    told = {"made of": made, **detection.in_each(each)}
    asked.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def of_tier(first: int) -> Tier:
    """Tier 1, its first set being this one."""
    return dataclasses.replace(TIERS[1], first=first)


def of_set(work: Path, effects: list[str], first: int) -> dict[str, Any]:
    """Limits in one set of scenes."""
    single_threaded()
    tier = of_tier(first)
    light, captures = work / str(first) / "light", work / str(first) / "captures"
    sensor = camera(tier.width, tier.height)
    if not light.exists():
        light_sets.write(light, tier.names(0), sensor)
    if not captures.exists():
        aside = captures.with_name(".captures")  # Named last: what is half done is done again.
        shutil.rmtree(aside, ignore_errors=True)
        shoot.shoot(light, NULL, aside / "null", frames=tier.frames)
        programs.depth(aside, light / programs.SENSOR)
        aside.rename(captures)
    believed = sensors.load(str(light / programs.SENSOR))
    cache = work / str(first) / "cache"
    return detection.limits(captures / "null", believed, wanted=effects or None, cache=cache)


if __name__ == "__main__":
    main()
