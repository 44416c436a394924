"""Modes of a camera: image sizes and frame rates, in the table `modes` of a sensor file.

A mode is a part of the imager in larger or smaller pixels. Its name is its image size:

    [modes."640x480"]
    scale = 0.6               # pixels of the image per pixel of the imager
    fps = [15, 30, 60]

The part lies in the middle of the imager. A scale of 1 crops. Further keys are those of a sensor;
they hold in this mode only. A file with a base drops modes of the base by a list of those it keeps:

    [modes]
    only = ["640x480"]
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from starling.patterns import errors
from starling.sim.sensor import structure
from starling.sim.sensor.sensor import Sensor

USUAL_FPS = 30.0  # Rate of a mode that is chosen without one, if the mode has it.
# A mode's name gives its size; name and kind are the camera's.
_KEYS = {"scale", "fps"} | {field.name for field in dataclasses.fields(Sensor)} - {
    *("name", "kind", "width", "height"),
}
NAME = re.compile(r"([1-9]\d{0,4})x([1-9]\d{0,4})")
_ONLY = "only"  # Key of the table that lists the kept modes of a base.
_EXAMPLE = "Example: 848x480 or 848x480@30."


@dataclass(frozen=True, kw_only=True, slots=True)
class Mode:
    """An image size of a camera, and its frame rates."""

    name: str
    width: int  # [px]
    height: int  # [px]
    scale: float  # Pixels of the image per pixel of the imager, along a row.
    fps: tuple[float, ...] = ()  # Frame rates [1/s]; () is unknown.
    changes: Mapping[str, Any] = field(default_factory=dict)  # Keys of this mode, as in a file.


@dataclass(frozen=True, kw_only=True, slots=True)
class ChosenMode:
    """A mode at a frame rate [1/s]; None is unknown."""

    mode: str
    fps: float | None


Modes = Mapping[str, Mode]


def read(table: Any) -> Modes:
    """Read the table `modes` of a sensor file.

    Raises:
        InputError: for a name that is no size, no scale, or frame rates that are no numbers.
    """
    if not isinstance(table, Mapping):
        raise errors.refuse("modes", "must be a table", repr(table), 'Write [modes."848x480"].')
    return {name: _mode(name, entry) for name, entry in table.items()}


def with_table(modes: Modes, table: Any) -> Modes:
    """Return the modes of a base with those of a file: further ones, or other keys of one.

    Modes that the file does not keep are still among them (see `select`).

    Raises:
        InputError: as `read`.
    """
    if not isinstance(table, Mapping):
        return read(table)
    result = dict(modes)
    for name, entry in table.items():
        if name == _ONLY:
            continue
        old = modes.get(name)
        if old is None or not isinstance(entry, Mapping):
            result[name] = _mode(name, entry)
        else:
            numbers = {"scale": old.scale, "fps": list(old.fps), **old.changes}
            result[name] = _mode(name, structure.merged(numbers, entry))
    return result


def select(modes: Modes, table: Mapping[str, Any], chosen: ChosenMode | None) -> Modes:
    """Return the modes of `with_table` that the file's list `only` keeps; all without a list.

    Modes with a table in the file are kept too.

    Args:
        modes: modes of the base and the file.
        table: table `modes` of the file.
        chosen: mode of the file's numbers, None if unknown.

    Raises:
        InputError: if the list is none, names an unknown mode, or lacks the mode of the numbers.
    """
    only = table.get(_ONLY)
    if only is None:
        return modes
    path = f"modes.{_ONLY}"
    if not isinstance(only, list) or not only:
        raise errors.refuse(path, "must list modes", repr(only), f'Write {_ONLY} = ["848x480"].')
    for name in only:
        errors.one_of(f"mode in {path}", name, modes)
    names = {*only, *table}
    if chosen is not None and chosen.mode not in names:
        rule, got = f"must list {chosen.mode}, the mode of the file", ", ".join(only)
        raise errors.refuse(path, rule, got, f'Add it, or give mode = "{only[0]}".')
    return {name: mode for name, mode in modes.items() if name in names}


def choose(modes: Modes, text: object, camera: str) -> ChosenMode:
    """Return the mode `WIDTHxHEIGHT` or `WIDTHxHEIGHT@FPS` of a camera.

    Without a rate it is 30 if the mode has it, and otherwise the mode's slowest.

    Args:
        modes: modes of the camera.
        text: mode in the user's words.
        camera: name of the camera for messages.

    Raises:
        InputError: if the camera has no such mode, or the mode no such rate.
    """
    if not isinstance(text, str):
        raise errors.refuse("mode", "must be text", repr(text), _EXAMPLE)
    if not modes:
        advice = "Leave the mode out, or list modes in a sensor file."
        raise errors.refuse(
            "mode", "must be of a camera with modes", f"{text!r} of {camera}", advice
        )
    name, at_sign, rate = text.partition("@")
    if name not in modes:
        raise errors.refuse("mode", f"must be a mode of {camera}", repr(text), f"{listed(modes)}.")
    if not at_sign:
        return ChosenMode(mode=name, fps=_usual(modes[name].fps))
    known = modes[name].fps
    if not known:
        advice = f"Add fps = [{rate or '30'}] to the mode, or leave the rate out."
        raise errors.refuse(
            "mode", "must be without a rate where the mode lists none", text, advice
        )
    fps = next((fps for fps in known if f"{fps:g}" == rate), None)
    if fps is None:
        advice = f"Rates: {', '.join(f'{fps:g}' for fps in known)}."
        raise errors.refuse("mode", f"must have a frame rate of {name}", repr(text), advice)
    return ChosenMode(mode=name, fps=fps)


def changes_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of a mode's table beyond scale and frame rates."""
    return {key: value for key, value in entry.items() if key not in ("scale", "fps")}


class Sized(Protocol):
    """A sensor or captures with an image size [px]."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...


def name_of(camera: Sized) -> str:
    """Return the name of the mode of an image size: `848x480`."""
    return f"{camera.width}x{camera.height}"


def listed(modes: Modes) -> str:
    """List the names of modes in a sentence without its full stop."""
    return f"Modes: {', '.join(modes)}"


def rows(modes: Modes, chosen: ChosenMode | None) -> list[dict[str, Any]]:
    """Return modes as rows for a table; `used` marks the one of a sensor."""
    return [
        {
            "mode": mode.name,
            "scale": mode.scale,
            "fps": [int(fps) if fps == int(fps) else fps for fps in mode.fps],
            "used": chosen is not None and mode.name == chosen.mode,
        }
        for mode in modes.values()
    ]


def lines(modes: Modes, chosen: ChosenMode | None) -> dict[str, dict[str, str]]:
    """Return modes as a table for people, by name."""
    return {
        row["mode"]: {"scale": f"{row['scale']:.4g}", "fps": "/".join(map(str, row["fps"])) or "-"}
        for row in rows(modes, chosen)
    }


def _usual(fps: tuple[float, ...]) -> float | None:
    return USUAL_FPS if USUAL_FPS in fps else min(fps, default=None)


def _mode(name: str, table: Any) -> Mode:
    size = NAME.fullmatch(name)
    path = f"modes.{name}"
    if not size:
        raise errors.refuse("name of a mode", "must be WIDTHxHEIGHT", repr(name), _EXAMPLE)
    if not isinstance(table, Mapping):
        raise errors.refuse(path, "must be a table", repr(table), f'Write [modes."{name}"].')
    for key in table:
        errors.one_of(f"key in {path}", key.partition(".")[0], _KEYS)
    if "scale" not in table:
        advice = "Give the pixels of the image per pixel of the imager."
        raise errors.refuse(f"{path}.scale", "must be given", "nothing", advice)
    errors.in_interval(f"{path}.scale", table["scale"], 1e-3, 16.0)
    rates = table.get("fps", [])
    if not isinstance(rates, list):
        raise errors.refuse(f"{path}.fps", "must be a list", repr(rates), "Example: [15, 30].")
    for rate in rates:
        errors.in_interval(f"{path}.fps", rate, 0.1, 1e5, "Give frames per second.")
    return Mode(
        name=name,
        width=int(size[1]),
        height=int(size[2]),
        scale=float(table["scale"]),
        fps=tuple(map(float, rates)),
        changes=changes_of(table),
    )
