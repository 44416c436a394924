"""Sensor presets and sensor files in TOML."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import tomli_w

from starling.patterns import errors
from starling.sim import files
from starling.sim.sensor import differences, intrinsics, search_end, sensor_file, structure
from starling.sim.sensor.imager import EXPOSURE
from starling.sim.sensor.sensor import Sensor
from starling.sim.sensor.sensor_file import SensorFile
from starling.sim.sensor.sensor_file import names as names
from starling.sim.sensor.sensor_table import from_table as from_table
from starling.sim.sensor.sensor_table import with_absolute_patterns as with_absolute_patterns


def summary() -> dict[str, dict[str, Any]]:
    """Return the main properties of each preset, and of one with a base the fields that differ."""
    return {name: _summary(name) for name in names()}


def _summary(name: str) -> dict[str, Any]:
    file = load_file(name)
    keys = ("kind", "width", "height", "fx_px", "baseline_m")
    row = {key: getattr(file.sensor, key) for key in keys}
    if file.description:
        row["description"] = file.description
    if file.base:
        paths = differences.changed_paths(load_file(file.base), file.sensor)
        row |= {"base": file.base, "differs": [path for path in paths if path != "name"]}
    return row


def load(name: str, *, mode: str = "") -> Sensor:
    """Load a preset by name, or a sensor file by its path (`.toml`).

    Paths of pattern images in a sensor file start at the file's folder, so that the folder can be
    moved.

    Args:
        name: preset or sensor file.
        mode: mode of the camera, `640x480` or `640x480@60`; by default the file's own.

    Raises:
        InputError: for an unknown preset (the message lists the known ones, nearest first), an
            unreadable file, a refused value, or an unknown mode.
    """
    return load_file(name, mode=mode).sensor


def load_file(name: str, *, mode: str = "", camera_matrix: str | Path | None = None) -> SensorFile:
    """Load a sensor with its modes, its base and its description.

    Args:
        name: preset or sensor file.
        mode: as for `load`.
        camera_matrix: file of a device's calibration, see `starling.sim.sensor.intrinsics`.

    Raises:
        InputError: as `load`, or for a calibration that does not fit.
    """
    path = sensor_file.path_of(name)
    file = sensor_file.read(path)
    _warn_of_right_exposure(file.sensor, path)
    if mode:
        file = sensor_file.in_mode(file, mode)
    if camera_matrix is not None:
        calibration = intrinsics.read(Path(camera_matrix))
        file = sensor_file.with_calibration(file, calibration, same_mode=bool(mode))
    if path.parent != sensor_file.PRESETS:
        search_end.warn(file.sensor, path)
    return file


def loaded(sensor: object) -> Sensor:
    """Return a sensor as it is.

    Raises:
        InputError: for a value that is no sensor, such as a name.
    """
    return errors.instance("sensor", sensor, Sensor, "Load it: starling.load_sensor(NAME).")


def resolved(sensor: object) -> Sensor:
    """Return a sensor as it is, or load it by its name.

    Raises:
        InputError: as `load`, and for other values.
    """
    return load(os.fspath(sensor)) if isinstance(sensor, (str, Path)) else loaded(sensor)


def text(name: str) -> str:
    """Return the text of a preset's file or of a sensor file, with the sources of its numbers.

    Raises:
        InputError: as `load`.
    """
    return files.read_text(sensor_file.path_of(name))


def dumps(sensor: Sensor) -> str:
    """Return a sensor as TOML text; `load` reads it back equal."""
    return tomli_w.dumps(structure.to_table(sensor))


def _warn_of_right_exposure(sensor: Sensor, path: Path) -> None:
    """Warn of a right exposure that differs from the left one, which both imagers take."""
    unused = [
        f"right.{name}"
        for name in EXPOSURE
        if getattr(sensor.right, name) != getattr(sensor.left, name)
    ]
    if sensor.kind == "stereo" and unused:
        message = f"{path}: {', '.join(unused)} not used: both imagers take the left one's."
        warnings.warn(message, stacklevel=2)
