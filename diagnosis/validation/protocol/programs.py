"""Programs that the check runs, each a process of its own that is told by files alone."""

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

_LAST_LINES = 3
_PROGRESS = re.compile(r" \d+/\d+$")
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SENSOR = "sensor.toml"


def light(out: Path, scenes: Sequence[str], width: int, height: int) -> None:
    """Write builtin scenes as light by Starling's renderer.

    Args:
        out: Folder to make.
        scenes: Names.
        width: Of the images [px].
        height: Likewise.

    Raises:
        WithheldError: if it fails, as all functions here.
    """
    size = ["--width", str(width), "--height", str(height)]
    _run("starling.diagnosis.validation.adapters.light_sets", [str(out), *scenes, *size])


def cycles(light: Path, out: Path, blender: Path) -> None:
    """Render a folder of light anew by Cycles.

    Args:
        light: Folder of light.
        out: Folder to make or to go on with.
        blender: Python with `bpy`.
    """
    _run(
        "starling.diagnosis.validation.adapters.cycles_light",
        [str(light), str(out), "--blender", str(blender)],
    )


def camera(out: Path, captures: Path, sensor: str) -> None:
    """Write what is believed of the camera of captures.

    Args:
        out: Folder to make.
        captures: Capture set.
        sensor: Preset or sensor file.
    """
    asked = ["--captures", str(captures), "--sensor", sensor]
    _run("starling.diagnosis.validation.adapters.captured_camera", [str(out), *asked])


def depth(cases: Path, sensor: Path) -> None:
    """Match all infrared pairs of a folder of capture sets by Starling's matcher."""
    _run("starling.diagnosis.validation.adapters.own_depth", [str(cases), "--sensor", str(sensor)])


def families(out: Path) -> None:
    """Write which families the diagnosis' table has, and what each effect is confused with."""
    _run("starling.diagnosis.validation.adapters.families", [str(out)])


def limits(out: Path, captures: Path, sensor: Path, cache: Path, effects: Sequence[str]) -> None:
    """Write how strong effects have to be to be found in captures of the same scenes.

    Args:
        out: File.
        captures: Capture set.
        sensor: What the camera is believed to be.
        cache: Folder that keeps what effects do to the scenes.
        effects: Names.
    """
    asked = ["--sensor", str(sensor), "--cache", str(cache), "--out", str(out)]
    asked += ["--against-itself", "--effects", *effects]
    _run("starling.diagnosis.validation.adapters.detection", [str(captures), *asked])


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
        cases: The capture sets; nothing else is told of them.
        out: Folder of verdicts; where effects are taken out, of `without family` and `without
            twins`.
        sensor: What the camera is believed to be.
        cache: Folder that keeps what effects do to the scenes.
        against: Capture set that each is compared with; None: with simulation.
        without: By capture set, an effect that is taken from the diagnosis' table with its family,
            and once more with those of the effects that the table says it is confused with.
    """
    arguments = [str(cases), str(out), "--sensor", str(sensor), "--cache", str(cache)]
    if against is not None:
        arguments += ["--against", str(against)]
    told = out / ".without"
    if without is not None:
        out.mkdir(parents=True, exist_ok=True)
        told.write_text(json.dumps(dict(without)), encoding="utf-8")
        arguments += ["--without", str(told)]
    try:
        _run("starling.diagnosis.validation.adapters.batch", arguments)
    finally:
        told.unlink(missing_ok=True)  # Nothing that tells stays beside captures.


def _run(module: str, arguments: Sequence[str]) -> None:
    last: deque[str] = deque(maxlen=_LAST_LINES)
    place = Path(arguments[0]).parent.name
    with subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **_ONE_THREAD},
    ) as running:
        assert running.stderr is not None
        for line in map(str.strip, running.stderr):
            if _PROGRESS.search(line):
                print(f"{place}: {line}", file=sys.stderr, flush=True)
            elif line:
                last.append(line)
    if running.returncode:
        raise refusal(module, "must succeed", f"exit {running.returncode}", " / ".join(last))
