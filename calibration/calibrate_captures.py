"""The work of `starling calibrate`: captures and a sensor in, a calibrated sensor file out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.calibration import fit_sensor
from starling.calibration.pattern import dots
from starling.calibration.report import figures as report
from starling.calibration.report import page
from starling.patterns import errors
from starling.sim.captures import capture
from starling.sim.console import progress, record
from starling.sim.console.output import (
    RECORD,
    OutputFolder,
    refuse_own_input,
    refuse_taken,
    write_file,
)
from starling.sim.render import backend
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor


def calibrate_captures(
    captures: str,
    sensor: Sensor,
    out: Path,
    *,
    free: Sequence[str],
    heldout: Sequence[str] | None = None,
    force: bool = False,
    asked: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Calibrate a sensor and write it, with its pattern and report in a folder beside it.

    Args:
        captures: capture set or one scene in it.
        sensor: to start from, with the captures' geometry (see `starling.sim.sensor.resolve`).
        out: sensor file to write, NAME.toml; NAME/ beside it holds the pattern's images, the dots,
            report.html, report.json and how they were made.
        free: groups to fit (see `starling.calibration.fit_sensor.GROUPS`).
        heldout: rooms to keep out of the fit; None chooses.
        force: replace what was written before.
        asked: more arguments for the record.
        track: wraps loops that take long.

    Returns:
        `{"parameters", "undetermined", "heldout", "seconds", "out", ...}` (see
        `starling.calibration.report.figures.figures`).

    Raises:
        InputError: whatever is wrong with captures, groups or output; nothing is left.
    """
    begun = time.perf_counter()
    if out.suffix != ".toml":
        raise errors.refuse("out", "must be a sensor file, NAME.toml", out, "End it in .toml.")
    refuse_taken(out, force=force)
    opened = capture.open_set(captures)
    beside = out.with_suffix("")
    refuse_own_input(beside, opened.path)
    with OutputFolder(beside, force=force) as folder:
        patterns_folder = folder.partial
        found = fit_sensor.fit(
            opened.scenes, sensor, free=free, folder=patterns_folder, heldout=heldout, track=track
        )
        figures = report.figures(found)
        for name in patterns_folder.glob("mirrored-*.png"):
            name.unlink()
        if found.recovered is not None:
            folder.write("dots.csv", dots.table(found.recovered, sensor))
        folder.write("report.json", record.dumps(figures))
        folder.write("report.html", page.page(found))
        folder.write(
            RECORD,
            record.dumps(
                {
                    "verb": "calibrate",
                    "arguments": {
                        "captures": captures,
                        "free": list(free),
                        "heldout": heldout,
                        **(asked or {}),
                    },
                    "versions": record.versions(),
                    "renderer": backend.renderer(),
                    "figures": figures,
                }
            ),
        )
        calibrated = _relative(found.sensor, patterns_folder, beside.name)
        folder.write("sensor.toml", presets.dumps(_relative(found.sensor, patterns_folder, "")))
    write_file(out, presets.dumps(calibrated).encode(), force=force)
    return {
        **figures,
        "out": str(out),
        "report": str(folder.path / "report.html"),
        "seconds": round(time.perf_counter() - begun, 3),
    }


def _relative(sensor: Sensor, folder: Path, prefix: str) -> Sensor:
    """Name the patterns that lie in `folder` from where the sensor file will be."""

    def near(name: str) -> str:
        path = Path(name)
        inside = path.is_absolute() and path.parent == folder.resolve()
        return "/".join(filter(None, (prefix, path.name))) if inside else name

    light = sensor.projector
    emitters = tuple(dataclasses.replace(one, pattern=near(one.pattern)) for one in light.emitters)
    light = dataclasses.replace(light, pattern=near(light.pattern), emitters=emitters)
    return dataclasses.replace(sensor, projector=light)
