r"""Diagnose a camera whose imagers have a vertical offset, as a user would.

Four rooms with reference depth, without `scene.toml`. The second camera implementation captures
them: another lens spot, occluded ambient light, and depth by another matcher.

Usage:
    python benchmarks/diagnosis/vertical_offset.py --work WORK [--offset 1.0] [--size 424 240]
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

from imperfect_base import IMPERFECTIONS

from starling.diagnosis.command import diagnose_captures
from starling.diagnosis.validation.adapters import light_sets
from starling.diagnosis.validation.adapters.cameras import builtin_camera
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.protocol import programs, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.rendered import match_captures
from starling.sim.sensor import resolve

SCENES = ("clutter:7120", "clutter:7121", "tabletop:7123", "clutter:7122")


def main() -> None:
    """Capture the rooms, diagnose them and print the answer."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--offset", type=float, default=1.0, help="vertical offset [px]")
    parser.add_argument("--size", type=int, nargs=2, default=(424, 240))
    options = parser.parse_args()
    light = options.work / "light"
    if not light.exists():
        light_sets.write(light, SCENES, builtin_camera(*options.size))
    captures = options.work / f"captures {options.offset:g}"
    if not captures.exists():
        case = Case(
            number=0,
            kind="single",
            settings={"vertical_offset": options.offset},
            seed=3,
            imperfections=IMPERFECTIONS,
        )
        part = options.work / "part"
        shutil.rmtree(part, ignore_errors=True)
        shoot.shoot(light, case, part, frames=2)
        match_captures(part, nominal.read(light / nominal.FILE))
        for path in part.glob("*/scene.toml"):
            path.unlink()
        part.rename(captures)
    result = diagnose_captures(
        str(captures),
        resolve.load(str(light / programs.SENSOR)),
        out=options.work / f"diagnosis {options.offset:g}",
        cache=options.work / "cache",
        force=True,
    )
    print(json.dumps({key: result[key] for key in ("verdict", "says", "notes")}, indent=1))
    for effect in result["effects"]:
        print(effect["name"], effect["parameters"], effect["interval"], effect["stand_in"])


if __name__ == "__main__":
    main()
