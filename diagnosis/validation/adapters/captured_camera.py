"""The camera of captures for the check on withheld effects: a sensor file, and what it means there.

    python -m starling.diagnosis.validation.adapters.captured_camera OUT --captures SET --sensor FILE

Writes OUT/sensor.toml, with the captures' geometry, and OUT/nominal.json, which beside the camera
names the effects that it has already.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from starling.diagnosis.validation.adapters import program
from starling.diagnosis.validation.adapters.light_sets import NOMINAL, SENSOR, nominal
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.console.output import OutputFolder
from starling.sim.effects import setting as setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets, resolve
from starling.sim.sensor.sensor import Sensor


def write(out: Path, sensor: Sensor) -> None:
    """Write what both sides of the check are told of a camera.

    The light in real rooms is not known; it counts as none, as nothing is done to it.

    Args:
        out: folder to make.
        sensor: with the captures' geometry.

    Raises:
        InputError: if the folder cannot be written.
    """
    told = {**nominal(sensor), "ambient_w_m2": 0.0, "ambient_gradient": 0.0, "has": _has(sensor)}
    with OutputFolder(out) as folder:
        folder.write(NOMINAL, json.dumps(told, indent=1).encode())
        folder.write(SENSOR, presets.dumps(sensor).encode())


def _has(sensor: Sensor) -> list[str]:
    """Effects that are not at their neutral."""
    scene = scenes.clutter(0)  # Of the sensor's own effects none looks at it.
    first = {row.name: row.parameters[0] for row in effects.table()}
    return sorted(
        name
        for name, one in first.items()
        if one.neutral is not None and setting.value(one, sensor, scene) not in (None, one.neutral)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where something is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.captured_camera",
        description="Write the camera of captures for the check on withheld effects.",
    )
    parser.add_argument("out", type=Path, help="folder to make")
    parser.add_argument("--captures", required=True, help="capture set, whose geometry counts")
    parser.add_argument("--sensor", required=True, help="preset or sensor file of their camera")
    asked = parser.parse_args(arguments)

    def work(_: progress.Progress) -> None:
        captures = capture.open_set(asked.captures).path
        write(asked.out, resolve.load(asked.sensor, captures=str(captures)))

    return program.run(work)


if __name__ == "__main__":
    sys.exit(main())
