r"""The camera of a capture set for the validation: its sensor file and nominal values.

    python -m starling.diagnosis.validation.adapters.captured_camera OUT \
        --captures SET --sensor FILE

Writes OUT/sensor.toml with the captures' geometry, and OUT/nominal.json. The latter also lists the
effects that the camera already has.
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
    """Write the camera description that both sides of the validation read.

    The ambient light of real rooms is unknown. It is written as zero, because no effect changes it.

    Args:
        out: folder to make.
        sensor: sensor with the captures' geometry.

    Raises:
        InputError: if the folder cannot be written.
    """
    values = {**nominal(sensor), "ambient_w_m2": 0.0, "ambient_gradient": 0.0, "has": _has(sensor)}
    with OutputFolder(out) as folder:
        folder.write(NOMINAL, json.dumps(values, indent=1).encode())
        folder.write(SENSOR, presets.dumps(sensor).encode())


def _has(sensor: Sensor) -> list[str]:
    """List effects of the sensor that are not neutral."""
    scene = scenes.clutter(0)  # Any scene: effects of the sensor do not depend on it.
    first = {row.name: row.parameters[0] for row in effects.table()}
    return sorted(
        name
        for name, parameter in first.items()
        if parameter.neutral is not None
        and setting.value(parameter, sensor, scene) not in (None, parameter.neutral)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 1 if the input is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.captured_camera",
        description="Write the camera of a capture set for the validation with withheld effects.",
    )
    parser.add_argument("out", type=Path, help="folder to make")
    parser.add_argument("--captures", required=True, help="capture set whose geometry is used")
    parser.add_argument("--sensor", required=True, help="preset or sensor file of their camera")
    options = parser.parse_args(arguments)

    def work(_: progress.Progress) -> None:
        captures = capture.open_set(options.captures).path
        write(options.out, resolve.load(options.sensor, captures=str(captures)))

    return program.run(work)


if __name__ == "__main__":
    sys.exit(main())
