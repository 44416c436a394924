"""Sensor presets and sensor files in TOML."""

from __future__ import annotations

import dataclasses
import os
import tomllib
import warnings
from pathlib import Path
from typing import Any

import tomli_w

from starling.patterns import errors, regular_file
from starling.sim import files
from starling.sim.sensor import matcher, structure
from starling.sim.sensor.imager import EXPOSURE
from starling.sim.sensor.sensor import Sensor

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """List the presets' names."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def summary() -> dict[str, dict[str, Any]]:
    """Return the main properties of each preset."""
    keys = ("kind", "width", "height", "fx_px", "baseline_m")
    presets = {name: load(name) for name in names()}
    return {name: {key: getattr(item, key) for key in keys} for name, item in presets.items()}


def load(name: str) -> Sensor:
    """Load a preset by name, or a sensor file by its path (`.toml`).

    Paths of pattern images in a sensor file start at the file's folder, so that the folder can be
    moved.

    Raises:
        InputError: for an unknown preset (the message lists the known ones, nearest first), an
            unreadable file, or a refused value.
    """
    return _read(_path(name))


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


def _path(name: str) -> Path:
    if name.endswith(".toml"):
        return Path(name)
    errors.one_of("sensor", name, names())
    return _FOLDER / f"{name}.toml"


def text(name: str) -> str:
    """Return the text of a preset's file or of a sensor file, with the sources of its numbers.

    Raises:
        InputError: as `load`.
    """
    return files.read_text(_path(name))


def with_absolute_patterns(sensor: Sensor, folder: str | Path) -> Sensor:
    """Make the paths of pattern images absolute; a pattern name with a suffix is a file."""
    projector = sensor.projector

    def full(name: str) -> str:
        return os.path.abspath(Path(folder) / name) if Path(name).suffix else name

    emitters = tuple(
        dataclasses.replace(emitter, pattern=full(emitter.pattern))
        for emitter in projector.emitters
    )
    projector = dataclasses.replace(projector, pattern=full(projector.pattern), emitters=emitters)
    return dataclasses.replace(sensor, projector=projector)


def dumps(sensor: Sensor) -> str:
    """Return a sensor as TOML text; `load` reads it back equal."""
    return tomli_w.dumps(structure.to_table(sensor))


def _read(path: Path) -> Sensor:
    try:
        table = tomllib.loads(regular_file.read(path).decode("utf-8-sig"))
    except OSError as error:
        raise errors.refuse(
            "sensor", "must be a readable file", path, f"{error.strerror}."
        ) from None
    except (ValueError, RecursionError) as error:  # Not TOML, not UTF-8, or nested too deep.
        raise errors.refuse("sensor", "must be TOML", path, f"{error}.") from None
    sensor = from_table(table)
    _warn_of_right_exposure(sensor, path)
    return with_absolute_patterns(sensor, path.parent)


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


def from_table(table: dict[str, Any]) -> Sensor:
    """Build a sensor from its tables. A missing `right` is a copy of `left`.

    `matcher.setting` names a stock setting (see `starling.sim.sensor.matcher.named`). The other
    keys of the table edit it, as tables or by dotted path. A table with a `kind` replaces a part.
    """
    structure.refuse_long_integers(table, "sensor")
    table = dict(table)
    if "left" in table and "right" not in table:
        table["right"] = table["left"]
    chosen = table.get("matcher")
    if isinstance(chosen, dict) and "setting" in chosen:
        stock = structure.to_table(matcher.named(chosen["setting"]))
        changes = {path: value for path, value in chosen.items() if path != "setting"}
        table["matcher"] = _edited(stock, changes)
    return structure.from_table(Sensor, table)


def _edited(stock: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Merge changes into a table without validating it."""
    table = dict(stock)
    for path, value in changes.items():
        name, _, rest = path.partition(".")
        new, old = {rest: value} if rest else value, table.get(name)
        if isinstance(new, dict) and isinstance(old, dict) and "kind" not in new:
            new = _edited(old, new)
        table[name] = new
    return table
