"""Depth for capture sets that hold only infrared pairs, by our matcher.

The validation with withheld effects needs a device with a known matcher, so that effects of its
filters can be withheld.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tyro.conf import Positional

from starling.diagnosis.scenes.observation import match_all_bits
from starling.patterns.errors import refuse
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import output, progress
from starling.sim.console.threads import single_threaded
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import depth_from_disparity, to_code

DEPTH = "depth.png"


def own_depth(cases: Positional[Path], *, sensor: str) -> None:
    """Match the infrared pairs of capture sets.

    Args:
        cases: folder of capture sets.
        sensor: preset or sensor file of all of them.
    """
    single_threaded()
    with progress.on_stderr() as track:
        write(cases, presets.load(sensor), track=track)


def write(cases: Path, sensor: Sensor, *, track: progress.Progress = progress.silent) -> None:
    """Match every infrared pair that has no depth.

    Args:
        cases: folder of capture sets.
        sensor: sensor whose matcher and depth unit are used.
        track: wraps the loop over capture sets.

    Raises:
        InputError: if there is no capture set or one is damaged.
    """
    for folder in track(capture_sets(cases), "depth"):
        for scene in capture.open_set(folder).scenes:
            for number in scene.frames:
                path = scene.path / str(number) / DEPTH
                if not path.exists():
                    output.write_file(path, png.encode(_codes(scene, number, sensor)))


def capture_sets(cases: Path) -> list[Path]:
    """List the capture sets in a folder by name, each in its own subfolder.

    Raises:
        InputError: if there is none.
    """
    folders = sorted(path.parent for path in cases.glob("*/capture.toml"))
    if not folders:
        raise refuse("cases", "must hold capture sets", cases, "Take captures first.")
    return folders


def _codes(scene: CapturedScene, number: int, sensor: Sensor) -> np.ndarray:
    frame = scene.frame(number)
    if frame.ir_left is None or frame.ir_right is None:
        raise refuse("capture", "must be an infrared pair", scene.path, "Take it again.")
    (disparity_px,) = match_all_bits(frame.ir_left[None], frame.ir_right[None], sensor)
    info = scene.info
    depth_m = depth_from_disparity(disparity_px, focal_px=info.fx_px, baseline_m=info.baseline_m)
    return to_code(depth_m, info.depth_unit_m)
