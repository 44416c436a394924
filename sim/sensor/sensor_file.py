"""Sensor files in TOML: the keys of a sensor, what they are based on, and modes.

Beyond the fields of `Sensor`, a file has these keys:

- `base`: preset, or file by its path from this file's folder. It supplies all other keys.
- `mode`: mode of this file's numbers, `640x480` or `640x480@60`. A base is converted to it first.
- `modes`: see `starling.sim.sensor.modes`.
- `camera_matrix`: file of a device's calibration, see `starling.sim.sensor.intrinsics`.
- `description`: one line for `starling sensors`.
"""

from __future__ import annotations

import dataclasses
import difflib
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns import errors, regular_file
from starling.sim.sensor import (
    edits,
    intrinsics,
    mode_keys,
    modes,
    other_kinds,
    scaling,
    sensor_table,
)
from starling.sim.sensor.intrinsics import DeviceCalibration
from starling.sim.sensor.modes import ChosenMode, Modes
from starling.sim.sensor.sensor import Sensor

PRESETS = Path(__file__).parent / "presets"
FILE_KEYS = ("base", "camera_matrix", "description", "mode", "modes")
_SENSOR_KEYS = tuple(field.name for field in dataclasses.fields(Sensor))
_SUFFIX = ".toml"
_MOST_BASES = 16  # Longest way from a file over its base, and the base of that, and so on.
_OF_CAMERA = frozenset(edits.OF_CAMERA)
_ADVICE = "Or give the path of a .toml file."


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorFile:
    """A sensor, and what its file says beyond it."""

    sensor: Sensor
    modes: Modes
    mode: ChosenMode | None  # Mode of the sensor; None if its size is that of none.
    own_right: bool  # Whether the file or its base has a right imager of its own.
    written: frozenset[str]  # Paths that the file or its base gives.
    base: str = ""
    description: str = ""
    calibration: DeviceCalibration | None = None


def names() -> list[str]:
    """List the presets' names."""
    return sorted(path.stem for path in PRESETS.glob(f"*{_SUFFIX}"))


def path_of(name: str, key: str = "sensor") -> Path:
    """Return the file of a preset, or the path that ends in `.toml`.

    Args:
        name: preset or path.
        key: name of the value in messages.

    Raises:
        InputError: for a camera of another principle, or an unknown preset. The message names the
            nearest preset.
    """
    if name.endswith(_SUFFIX):
        return Path(name)
    other_kinds.refuse(key, name)
    try:
        errors.one_of(key, name, names())
    except errors.InputError as error:
        raise errors.InputError(f"{error} {_ADVICE}") from None
    return PRESETS / f"{name}{_SUFFIX}"


def read(path: Path) -> SensorFile:
    """Read a sensor file.

    Raises:
        InputError: for an unreadable file or base, a base that leads back, an unknown key, or a
            refused value.
    """
    return _read(path, "sensor", ())


def in_mode(file: SensorFile, text: object) -> SensorFile:
    """Return the sensor of a file in one of its modes, such as `640x480@60`.

    Raises:
        InputError: if the camera has no such mode, or the sensor's image size is that of no mode.
    """
    chosen = modes.choose(file.modes, text, file.sensor.name)
    if file.mode is None:
        advice = f"Leave width and height as they are. {modes.listed(file.modes)}."
        rule, got = "must start from an image size of a mode", modes.name_of(file.sensor)
        raise errors.refuse("mode", rule, got, advice)
    old, new = file.modes[file.mode.mode], file.modes[chosen.mode]
    sensor = file.sensor
    if new.name != old.name:
        sensor = scaling.scaled(sensor, new.scale / old.scale, new.width, new.height)
        sensor = sensor_table.changed(sensor, new.changes, own_right=file.own_right)
        if file.calibration is not None and new.name in file.calibration.sizes:
            sensor = intrinsics.with_calibration(sensor, file.calibration)
    if chosen.fps is not None and file.mode.fps is not None:
        sensor = scaling.at_rate(sensor, chosen.fps, before=file.mode.fps)
    return dataclasses.replace(file, sensor=sensor, mode=chosen)


def with_calibration(
    file: SensorFile, calibration: DeviceCalibration, *, same_mode: bool
) -> SensorFile:
    """Return a sensor file with a device's calibration.

    Args:
        file: sensor file.
        calibration: calibration. That of a single image size chooses the mode of that size.
        same_mode: whether the sensor has to stay in its mode.

    Raises:
        InputError: if the calibration does not fit the sensor.
    """
    sizes = calibration.sizes
    sole = len(sizes) == 1 and sizes[0] in file.modes and sizes[0] != modes.name_of(file.sensor)
    if sole and not same_mode and file.mode is not None:
        file = in_mode(file, sizes[0])
    cut = 1.0
    if file.mode is not None:
        columns = {mode.name: mode.width / mode.scale for mode in file.modes.values()}
        cut = max(columns.values()) / columns[file.mode.mode]
    sensor = intrinsics.with_calibration(file.sensor, calibration, cut=cut)
    return dataclasses.replace(file, sensor=sensor, calibration=calibration)


def refuse_unreadable(text: str, folder: Path) -> None:
    """Refuse the text of a sensor file that `read` would refuse in a folder.

    Raises:
        InputError: as `read`.
    """
    _from_table(tomllib.loads(text), folder / f"new{_SUFFIX}", ())


def _read(path: Path, key: str, chain: tuple[Path, ...]) -> SensorFile:
    return _from_table(_toml(path, key), path, chain)


def _from_table(table: dict[str, Any], path: Path, chain: tuple[Path, ...]) -> SensorFile:
    for name in table:
        errors.one_of("key", name, (*_SENSOR_KEYS, *FILE_KEYS))
    for name in ("base", "camera_matrix", "description"):
        errors.instance(name, table.get(name, ""), str, "Quote the text.")
    calibration = None
    if "camera_matrix" in table:
        if not table["camera_matrix"]:
            rule, advice = "must name a file", "Leave the key out, or give the path."
            raise errors.refuse("camera_matrix", rule, "no text", advice)
        calibration = intrinsics.read(path.parent / table["camera_matrix"])
    keys = {name: value for name, value in table.items() if name not in FILE_KEYS}
    mode_keys.refuse_twice(keys, "")
    if "base" in table:
        chain = (*chain, Path(os.path.abspath(path)))
        file = _derived(_base(table["base"], chain), table, keys, calibration, path)
    else:
        file = _root(table, keys, calibration, path)
    for name, entry in table.get("modes", {}).items():
        if isinstance(entry, Mapping) and modes.changes_of(entry):
            _refuse_mode(file, name, entry)
    return dataclasses.replace(
        file,
        sensor=sensor_table.with_absolute_patterns(file.sensor, path.parent),
        description=table.get("description", ""),
        base=table.get("base", ""),
    )


def _root(
    table: Mapping[str, Any],
    keys: dict[str, Any],
    calibration: DeviceCalibration | None,
    path: Path,
) -> SensorFile:
    known = modes.read(table.get("modes", {}))
    if calibration is not None:
        keys = intrinsics.with_keys(calibration, keys)
    sensor = sensor_table.from_table(keys)
    chosen = None
    if "mode" in table:
        with errors.naming(path.name):
            chosen = modes.choose(known, table["mode"], sensor.name)
        _refuse_other_size(sensor, chosen)
    elif modes.name_of(sensor) in known:
        chosen = modes.choose(known, modes.name_of(sensor), sensor.name)
    if chosen is not None and known[chosen.mode].changes:
        rule, got = "must have scale and fps only", ", ".join(known[chosen.mode].changes)
        advice = "The keys of the file itself are of this mode."
        raise errors.refuse(f"modes.{chosen.mode}", rule, got, advice)
    return SensorFile(
        sensor=sensor,
        modes=mode_keys.filled(known, chosen, sensor),
        mode=chosen,
        own_right="right" in keys,
        written=frozenset(mode_keys.paths(keys)),
        calibration=calibration,
    )


def _derived(
    file: SensorFile,
    table: Mapping[str, Any],
    keys: dict[str, Any],
    calibration: DeviceCalibration | None,
    path: Path,
) -> SensorFile:
    own_modes = table.get("modes", {})
    known = modes.with_table(file.modes, own_modes)
    known = mode_keys.without(mode_keys.filled(known, file.mode, file.sensor), keys)
    known = modes.with_table(known, own_modes)
    before = file.mode
    file = dataclasses.replace(file, modes=known)
    if "mode" in table:
        with errors.naming(path.name):  # The message names the base's camera.
            file = in_mode(file, table["mode"])
    if before is not None and file.mode is not None and before.mode == file.mode.mode:
        file = _with_own_keys(file, own_modes.get(before.mode, {}))
    if calibration is not None:
        file = with_calibration(file, calibration, same_mode="mode" in table)
    if not _OF_CAMERA.isdisjoint(keys):  # The file's own numbers win in all modes.
        file = dataclasses.replace(file, calibration=None)
    own_right = file.own_right or "right" in keys
    sensor = sensor_table.changed(file.sensor, keys, own_right=own_right)
    chosen = file.mode
    if chosen is not None and chosen.mode != modes.name_of(sensor):
        if "mode" in table:
            _refuse_other_size(sensor, chosen)
        chosen = None
    return dataclasses.replace(
        file,
        sensor=sensor,
        modes=modes.select(known, table.get("modes", {}), chosen),
        mode=chosen,
        own_right=own_right,
        written=file.written | frozenset(mode_keys.paths(keys)),
    )


def _with_own_keys(file: SensorFile, entry: Mapping[str, Any]) -> SensorFile:
    """Return a file with the keys that its table of modes gives to the mode of its base."""
    changes = modes.changes_of(entry)
    sensor = sensor_table.changed(file.sensor, changes, own_right=file.own_right)
    return dataclasses.replace(file, sensor=sensor)


def _refuse_mode(file: SensorFile, name: str, entry: Mapping[str, Any]) -> None:
    """Refuse keys of a mode that could not be used; the mode need not be chosen."""
    mode_keys.refuse_twice(entry, f" in modes.{name}")
    with errors.naming(f"modes.{name}"):
        if file.mode is not None:
            in_mode(file, name)
            return
        width, height = file.modes[name].width, file.modes[name].height
        sensor = scaling.scaled(file.sensor, width / file.sensor.width, width, height)
        sensor_table.changed(sensor, modes.changes_of(entry), own_right=file.own_right)


def _base(name: str, chain: tuple[Path, ...]) -> SensorFile:
    path = Path(os.path.abspath(chain[-1].parent / path_of(name, "base")))
    if path in chain:
        way = " -> ".join(step.name for step in (*chain[chain.index(path) :], path))
        raise errors.refuse("base", "must not lead back to its own file", way, "Drop a base.")
    if len(chain) > _MOST_BASES:
        rule, got = f"must end after {_MOST_BASES} files", f"{len(chain)} files, {name} next"
        raise errors.refuse("base", rule, got, "Merge some of them.")
    return _read(path, "base", chain)


def _toml(path: Path, key: str) -> dict[str, Any]:
    try:
        return tomllib.loads(regular_file.read(path).decode("utf-8-sig"))
    except OSError as error:
        advice = f"{error.strerror}.{_nearest(path)}"
        raise errors.refuse(key, "must be a readable file", path, advice) from None
    except (ValueError, RecursionError) as error:  # Not TOML, not UTF-8, or nested too deep.
        raise errors.refuse(key, "must be TOML", path, f"{error}.") from None


def _nearest(path: Path) -> str:
    """Name the sensor file of the same folder with the nearest name, as a sentence."""
    try:
        known = [file.name for file in path.parent.glob(f"*{_SUFFIX}")]
    except (OSError, ValueError):  # Unreadable, or a name with a null byte.
        return ""
    near = difflib.get_close_matches(path.name, known, n=1)
    return f" Nearest: {near[0]}." if near else ""


def _refuse_other_size(sensor: Sensor, chosen: ChosenMode) -> None:
    if chosen.mode != modes.name_of(sensor):
        rule = f"must be those of the mode {chosen.mode}"
        got = modes.name_of(sensor)
        raise errors.refuse("width and height", rule, got, "Leave them out, or mode.")
