"""Run `starling calibrate`: fit a sensor to captures, write the sensor file and its report."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.calibration import MOST_SCENES, fit_sensor
from starling.calibration.pattern import dots
from starling.calibration.report import page
from starling.calibration.report.figures import calibration_figures
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
    most_scenes: int = MOST_SCENES,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Calibrate a sensor; write its file, and its pattern and report to a folder of that name.

    Args:
        captures: capture set or one of its scenes.
        sensor: initial sensor, with the captures' geometry (see `starling.sim.sensor.resolve`).
        out: sensor file to write, NAME.toml. The folder NAME/ next to it gets the pattern's
            images, the dots, report.html, report.json and a record of the run.
        free: groups to fit (see `starling.calibration.fit_sensor.GROUPS`).
        heldout: rooms to exclude from the fit; None selects every fourth room.
        most_scenes: as for `starling.calibration.fit_sensor.fit`.
        force: overwrite existing output.
        options: further command-line options to record, as typed.
        track: progress callback around long loops.

    Returns:
        `{"parameters", "undetermined", "heldout", "seconds", "out", ...}` (see
        `starling.calibration.report.figures.calibration_figures`).

    Raises:
        InputError: if captures, groups or output are invalid. Partial output is removed.
    """
    start_s = time.perf_counter()
    if out.suffix != ".toml":
        raise errors.refuse("out", "must be a sensor file, NAME.toml", out, "End it in .toml.")
    refuse_taken(out, force=force)
    opened = capture.open_set(captures)
    output_folder = out.with_suffix("")
    refuse_own_input(output_folder, opened.path)
    with OutputFolder(output_folder, force=force) as folder:
        patterns_folder = folder.partial
        calibration = fit_sensor.fit(
            opened.scenes,
            sensor,
            free=free,
            folder=patterns_folder,
            heldout=heldout,
            most_scenes=most_scenes,
            track=track,
        )
        figures = calibration_figures(calibration)
        for name in patterns_folder.glob("mirrored-*.png"):
            name.unlink()
        if calibration.recovered is not None:
            folder.write("dots.csv", dots.table(calibration.recovered, sensor))
        folder.write("report.json", record.dumps(figures))
        folder.write("report.html", page.page(calibration))
        arguments = {
            "captures": captures,
            "free": list(free),
            "heldout": heldout,
            "most_scenes": most_scenes,
        }
        run = {
            "verb": "calibrate",
            "arguments": {**arguments, **(options or {})},
            "versions": record.versions(),
            "renderer": backend.renderer(),
            "figures": figures,
        }
        folder.write(RECORD, record.dumps(run))
        calibrated = _relative(calibration.sensor, patterns_folder, output_folder.name)
        local = _relative(calibration.sensor, patterns_folder, "")
        folder.write("sensor.toml", presets.dumps(local))
    write_file(out, presets.dumps(calibrated).encode(), force=force)
    return {
        **figures,
        "out": str(out),
        "report": str(folder.path / "report.html"),
        "seconds": round(time.perf_counter() - start_s, 3),
    }


def _relative(sensor: Sensor, folder: Path, prefix: str) -> Sensor:
    """Make the names of patterns in `folder` relative to the sensor file's final location."""

    def relative_name(name: str) -> str:
        path = Path(name)
        inside = path.is_absolute() and path.parent == folder.resolve()
        return "/".join(filter(None, (prefix, path.name))) if inside else name

    light = sensor.projector
    emitters = tuple(
        dataclasses.replace(emitter, pattern=relative_name(emitter.pattern))
        for emitter in light.emitters
    )
    light = dataclasses.replace(light, pattern=relative_name(light.pattern), emitters=emitters)
    return dataclasses.replace(sensor, projector=light)
