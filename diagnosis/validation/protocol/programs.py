"""Programs that the check runs in separate processes. They communicate through files only."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

from starling.diagnosis.validation.camera.errors import refusal

_LAST_LINES = 3  # Lines of standard error in the message of a failed program.
_PROGRESS = re.compile(r" \d+/\d+$")
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SENSOR = "sensor.toml"


def light(out: Path, scenes: Sequence[str], width: int, height: int) -> None:
    """Render the light of builtin scenes with Starling's renderer.

    Args:
        out: Folder to create.
        scenes: Names of the scenes.
        width: Width of the images [px].
        height: Height of the images [px].

    Raises:
        WithheldError: if the program fails. All functions of this module raise it.
    """
    size = ["--width", str(width), "--height", str(height)]
    _run("starling.diagnosis.validation.adapters.light_sets", [str(out), *scenes, *size])


def cycles(light: Path, out: Path, blender: Path) -> None:
    """Render the scenes of a light folder with Cycles.

    Args:
        light: Folder of light.
        out: Folder to create or to complete.
        blender: Python interpreter with `bpy`.
    """
    _run(
        "starling.diagnosis.validation.adapters.cycles_light",
        [str(light), str(out), "--blender", str(blender)],
    )


def camera(out: Path, captures: Path, sensor: str) -> None:
    """Write the nominal camera of a capture set.

    Args:
        out: Folder to create.
        captures: Capture set.
        sensor: Preset or sensor file.
    """
    options = ["--captures", str(captures), "--sensor", sensor]
    _run("starling.diagnosis.validation.adapters.captured_camera", [str(out), *options])


def depth(cases: Path, sensor: Path) -> None:
    """Match all infrared pairs of a folder of capture sets with Starling's matcher."""
    _run("starling.diagnosis.validation.adapters.own_depth", [str(cases), "--sensor", str(sensor)])


def families(out: Path) -> None:
    """Write the family and the confusable effects of each effect of the diagnosis' table."""
    _run("starling.diagnosis.validation.adapters.families", [str(out)])


def limits(out: Path, captures: Path, sensor: Path, cache: Path, effects: Sequence[str]) -> None:
    """Measure the detection limits of effects in captures of the same scenes.

    Args:
        out: File to write.
        captures: Capture set.
        sensor: Sensor file of the nominal camera.
        cache: Folder of cached simulations.
        effects: Names of the effects.
    """
    options = ["--sensor", str(sensor), "--cache", str(cache), "--out", str(out)]
    options += ["--against-itself", "--effects", *effects]
    _run("starling.diagnosis.validation.adapters.detection", [str(captures), *options])


def diagnose(
    cases: Path,
    out: Path,
    sensor: Path,
    cache: Path,
    *,
    against: Path | None = None,
    without: Mapping[str, str] | None = None,
) -> None:
    """Diagnose a folder of capture sets.

    Args:
        cases: Folder of the capture sets.
        out: Folder of verdicts. With `without`, the parent of `without family` and `without twins`.
        sensor: Sensor file of the nominal camera.
        cache: Folder of cached simulations.
        against: Reference capture set; None compares with the simulation.
        without: Effect to leave out, by capture set. One verdict leaves out the family of the
            effect, a second one also the families of its confusable effects.
    """
    arguments = [str(cases), str(out), "--sensor", str(sensor), "--cache", str(cache)]
    if against is not None:
        arguments += ["--against", str(against)]
    without_file = out / ".without"
    if without is not None:
        out.mkdir(parents=True, exist_ok=True)
        without_file.write_text(json.dumps(dict(without)), encoding="utf-8")
        arguments += ["--without", str(without_file)]
    try:
        _run("starling.diagnosis.validation.adapters.batch", arguments)
    finally:
        without_file.unlink(missing_ok=True)  # The file reveals the true effects.


def _run(module: str, arguments: Sequence[str]) -> None:
    last: deque[str] = deque(maxlen=_LAST_LINES)
    set_name = Path(arguments[0]).parent.name
    with subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **_ONE_THREAD},
    ) as running:
        assert running.stderr is not None
        for line in map(str.strip, running.stderr):
            if _PROGRESS.search(line):
                print(f"{set_name}: {line}", file=sys.stderr, flush=True)
            elif line:
                last.append(line)
    if running.returncode:
        raise refusal(module, "must succeed", f"exit {running.returncode}", " / ".join(last))
