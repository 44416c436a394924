"""Diagnose depth by our matcher with another setting, or by a matcher of another make.

The base is perfect otherwise. Our settings must be named, and no effect for another make. A make
that is the device is left out of the makes that the diagnosis knows.

Usage:
    python benchmarks/diagnosis/matcher_settings.py --work WORK [--devices left_right_threshold]
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from unittest import mock

from imperfect_base import FRAMES, make_light

from starling.diagnosis.scenes.scene_model import load_scene_model
from starling.diagnosis.scenes.selection import split_test_rooms
from starling.diagnosis.validation.adapters import own_depth
from starling.diagnosis.validation.protocol import programs, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.which import attribution, discrepancy
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.makes import other_makes
from starling.sim.captures import capture
from starling.sim.console.threads import single_threaded
from starling.sim.effects import setting
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

SETTINGS = {
    "left_right_threshold": 0.35,
    "uniqueness": 15.0,
    "texture_threshold": 2.0,
    "large_penalty": 20.0,
    "census_window": 5,
}
MAKE = "make"  # Start of the name of another make, before its number.


def main() -> None:
    """Diagnose each device and print its effects; parentheses mark surrogates."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--devices", nargs="*", help="settings, or make0 to make6; default: all")
    options = parser.parse_args()
    single_threaded()
    light = make_light(options.work)
    base = presets.load(str(light / programs.SENSOR))
    count = len(other_makes(base.matcher))
    for name in options.devices or [*SETTINGS, *(f"{MAKE}{n}" for n in range(count))]:
        print(name, answer(options.work / name, light, name, base), flush=True)


def answer(folder: Path, light: Path, name: str, base: Sensor) -> str:
    """Capture the scenes with a device, and diagnose its depth."""
    makes = other_makes(base.matcher)
    known = makes
    if name.startswith(MAKE):
        number = int(name.removeprefix(MAKE))
        device = dataclasses.replace(base, matcher=makes[number])
        known = (*makes[:number], *makes[number + 1 :])
    else:
        device = setting.on_sensor(base, {name: SETTINGS[name]})
    if not folder.exists():
        shoot.shoot(light, Case(number=0, kind="null", seed=5), folder / "0", frames=FRAMES)
        own_depth.write(folder, device)
    scenes = capture.open_set(folder / "0").scenes
    training, held_out = split_test_rooms([load_scene_model(scene, base) for scene in scenes])
    screened = attribution.screen_segment(Segment.DEPTH, training)
    with mock.patch.object(discrepancy, "other_makes", lambda _: known):
        result = attribution.attribute_effects([screened], held_out)
    (segment,) = result.segments
    parts = []
    for effect in segment.search.accepted:
        value = effect.fit.value
        text = f"{effect.fit.name} {value if isinstance(value, str) else f'{value:.3g}'}"
        reasons = result.evidence[effect.fit.name].reasons
        parts.append(f"({text}: {', '.join(reasons)})" if reasons else text)
    return f"{result.kind}: {'; '.join(parts)}"


if __name__ == "__main__":
    main()
