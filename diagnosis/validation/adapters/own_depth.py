"""Depth for capture sets that hold only infrared pairs, by our matcher.

    python -m starling.diagnosis.validation.adapters.own_depth CASES --sensor FILE

The validation with withheld effects needs a device with a known matcher, so that effects of its
filters can be withheld. CASES holds capture sets in subfolders.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from starling.diagnosis.scenes.observation import match_all_bits
from starling.diagnosis.validation.adapters import program
from starling.patterns.errors import refuse
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import output, progress
from starling.sim.console.threads import single_threaded
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import depth_from_disparity, to_code

DEPTH = "depth.png"


def write(cases: Path, sensor: Sensor, *, track: progress.Progress = progress.silent) -> None:
    """Match every infrared pair that has no depth.

    Args:
        cases: folder of capture sets.
        sensor: sensor whose matcher and depth unit are used.
        track: wraps the loop over capture sets.

    Raises:
        InputError: if there is no capture set or one is damaged.
    """
    for folder in track(program.capture_sets(cases), "depth"):
        for scene in capture.open_set(folder).scenes:
            for number in scene.frames:
                path = scene.path / str(number) / DEPTH
                if not path.exists():
                    output.write_file(path, png.encode(_codes(scene, number, sensor)))


def _codes(scene: CapturedScene, number: int, sensor: Sensor) -> np.ndarray:
    frame = scene.frame(number)
    if frame.ir_left is None or frame.ir_right is None:
        raise refuse("capture", "must be an infrared pair", scene.path, "Take it again.")
    (disparity_px,) = match_all_bits(frame.ir_left[None], frame.ir_right[None], sensor)
    info = scene.info
    depth_m = depth_from_disparity(disparity_px, focal_px=info.fx_px, baseline_m=info.baseline_m)
    return to_code(depth_m, info.depth_unit_m)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 1 if the input is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.own_depth",
        description="Match infrared pairs of capture sets.",
    )
    parser.add_argument("cases", type=Path, help="folder of capture sets")
    parser.add_argument("--sensor", required=True, help="preset or sensor file of all of them")
    options = parser.parse_args(arguments)
    single_threaded()
    return program.run(
        lambda track: write(options.cases, presets.load(options.sensor), track=track)
    )


if __name__ == "__main__":
    sys.exit(main())
