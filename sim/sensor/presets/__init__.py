"""Sensor presets and sensor files: TOML in, TOML out."""

from __future__ import annotations

import dataclasses
import os
import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from starling.patterns import errors
from starling.sim.sensor import matcher, structure
from starling.sim.sensor.sensor import Sensor

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """List the presets' names."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def summary() -> dict[str, dict[str, Any]]:
    """Say of every preset what tells it from the others."""
    keys = ("kind", "width", "height", "fx_px", "baseline_m")
    presets = {name: load(name) for name in names()}
    return {name: {key: getattr(item, key) for key in keys} for name, item in presets.items()}


def load(name: str) -> Sensor:
    """Load a preset by name, or a sensor file by its path (`.toml`).

    Image files that a sensor file names as patterns are looked for from its own folder, so that
    the folder can be moved as a whole.

    Raises:
        InputError: unknown preset (the known ones are listed, nearest first), unreadable file,
            or a refused value.
    """
    if name.endswith(".toml"):
        return _read(Path(name))
    errors.one_of("sensor", name, names())
    return _read(_FOLDER / f"{name}.toml")


def text(name: str) -> str:
    """Return a preset's file as it stands, sources included."""
    errors.one_of("sensor", name, names())
    return (_FOLDER / f"{name}.toml").read_text(encoding="utf-8")


def anchored(sensor: Sensor, folder: str | Path) -> Sensor:
    """Give patterns' image files their full paths, from a folder: what has a suffix is a file."""
    part = sensor.projector

    def full(name: str) -> str:
        return os.path.abspath(Path(folder) / name) if Path(name).suffix else name

    emitters = tuple(
        dataclasses.replace(emitter, pattern=full(emitter.pattern)) for emitter in part.emitters
    )
    part = dataclasses.replace(part, pattern=full(part.pattern), emitters=emitters)
    return dataclasses.replace(sensor, projector=part)


def dumps(sensor: Sensor) -> str:
    """Write a sensor as TOML text that `load` reads back equal (see there for patterns' files)."""
    return tomli_w.dumps(structure.to_table(sensor))


def _read(path: Path) -> Sensor:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise errors.refuse(
            "sensor", "must be a readable file", path, f"{error.strerror}."
        ) from None
    except (ValueError, RecursionError) as error:  # No TOML, no UTF-8, or nested too deep.
        raise errors.refuse("sensor", "must be TOML", path, f"{error}.") from None
    return anchored(from_table(table), path.parent)


def from_table(table: dict[str, Any]) -> Sensor:
    """Build a sensor from its tables; `right` left out means: as `left`.

    `matcher.setting` names a stock setting (see `starling.sim.sensor.matcher.named`) that the rest of the table
    edits, in tables or by dotted path; a table with a `kind` takes the place of a part.
    """
    structure.refuse_long_integers(table, "sensor")
    table = dict(table)
    if "left" in table and "right" not in table:
        table["right"] = table["left"]
    chosen = table.get("matcher")
    if isinstance(chosen, dict) and "setting" in chosen:
        stock = structure.to_table(matcher.named(chosen["setting"]))
        told = {path: value for path, value in chosen.items() if path != "setting"}
        table["matcher"] = _edited(stock, told)
    return structure.from_table(Sensor, table)


def _edited(stock: dict[str, Any], told: dict[str, Any]) -> dict[str, Any]:
    """A table with all that another tells of it; only the whole has to be possible."""
    table = dict(stock)
    for path, value in told.items():
        name, _, rest = path.partition(".")
        new, old = {rest: value} if rest else value, table.get(name)
        if isinstance(new, dict) and isinstance(old, dict) and "kind" not in new:
            new = _edited(old, new)
        table[name] = new
    return table
