"""Edits of a sensor by dotted path, given as text or as values."""

from __future__ import annotations

import re
import tomllib
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import arrays
from starling.sim.sensor import matcher, overlaps, structure
from starling.sim.sensor.imager import EXPOSURE
from starling.sim.sensor.sensor import Sensor

OF_CAMERA = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px")  # Replaced by `with_camera`.
_AXES = "xyz"
_BARE_WORD = re.compile(r"[A-Za-z_][\w./-]*")


def apply(sensor: Sensor, edits: Iterable[str]) -> Sensor:
    """Apply edits in order. Only the final sensor must be valid, not the intermediate ones.

    Args:
        sensor: Sensor to edit.
        edits: Edits of the form `PATH=VALUE`: a dotted path to a field, and a TOML value. A bare
            word is text. `imager.X` edits both imagers, `PATH.x` one component of three.
            `matcher.setting` loads a stock setting by name.

    Raises:
        InputError: for an edit that is not `PATH=VALUE`, or as `with_values`.

    Example:
        >>> apply(sensors.load("d435"), ["projector.power_w=0.2"]).projector.power_w
        0.2
    """
    values = [_parse(edit) for edit in edits]
    unused = [path for path, _ in values if path in {f"right.{name}" for name in EXPOSURE}]
    if unused:
        message = f"{', '.join(unused)} not used: both imagers take the left one's."
        warnings.warn(message, stacklevel=2)
    overlaps.warn_of_edits([path for path, _ in values])
    _warn_of_centre(sensor, dict(values))
    return with_values(sensor, values)


def _warn_of_centre(sensor: Sensor, values: Mapping[str, Any]) -> None:
    """Warn of an image size that leaves the principal point where it was."""
    for side, centre in (("width", "cx_px"), ("height", "cy_px")):
        pixels = values.get(side)
        if not isinstance(pixels, int) or centre in values or pixels == getattr(sensor, side):
            continue
        text = f"set: {side} is {pixels}, but {centre} stays {getattr(sensor, centre):g}."
        message = f"{text} A centred camera has {(pixels - 1) / 2:g}."
        warnings.warn(message, stacklevel=3)


def path_of(edit: str) -> str:
    """Return the path of an edit `PATH=VALUE`."""
    return edit.partition("=")[0].strip()


def with_values(sensor: Sensor, values: Iterable[tuple[str, Any]]) -> Sensor:
    """Set fields in order, as `apply` does, by (path, value).

    Raises:
        InputError: for an unknown path, a path to a whole table, a refused value, or a pattern
            when all emitters have their own.
    """
    table, values = structure.to_table(sensor), list(values)
    for path, value in values:
        if path == "matcher.setting":
            table["matcher"] = structure.to_table(_stock_matcher(value))
        elif path.partition(".")[0] == "imager":
            for side in ("left", "right"):
                _set(table, side + path.removeprefix("imager"), value, typed=path)
        else:
            _set(table, path, value, typed=path)
    try:
        edited = structure.from_table(Sensor, table)
    except errors.InputError as error:
        message = _as_typed(str(error), [path for path, _ in values])
        raise errors.InputError(message) from error
    _refuse_hidden_pattern(edited, dict(values))
    return edited


def with_camera(sensor: Sensor, camera_matrix: Any, size: tuple[int, int]) -> Sensor:
    """Give a sensor other intrinsics, with its own focal length: pixels grow or shrink.

    Args:
        sensor: Sensor to edit.
        camera_matrix: (3, 3) intrinsics of a rectified image [px].
        size: (width, height) [px].

    Raises:
        InputError: for no camera matrix, or intrinsics that the sensor cannot have.
    """
    k = checked_matrix(camera_matrix)
    if np.shape(size) != (2,):
        raise errors.refuse("size", "must be (width, height)", size, "Give pixels.")
    values: list[tuple[str, Any]] = [
        (name, errors.whole_number(name, side, 1, 2**31))
        for name, side in zip(("width", "height"), size, strict=True)
    ]
    places = {"fx_px": (0, 0), "fy_px": (1, 1), "cx_px": (0, 2), "cy_px": (1, 2)}
    values += [(name, float(k[place])) for name, place in places.items()]
    for side, imager in (("left", sensor.left), ("right", sensor.right)):
        pitch = imager.pixel_pitch_m * sensor.fx_px / k[0, 0]
        values.append((f"{side}.pixel_pitch_m", float(pitch)))
    return with_values(sensor, values)


def checked_matrix(matrix: Any, name: str = "camera_matrix") -> NDArray[np.float64]:
    """Return a camera matrix (3, 3) [px], or refuse it by its name."""
    form = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    k = arrays.numbers(name, matrix).astype(np.float64)
    if k.shape != (3, 3) or not np.isfinite(k).all():
        raise errors.refuse(name, f"must be {form}, finite", k.tolist(), "Give pixels.")
    if k[2, 0] or k[2, 1]:
        raise errors.refuse(name, f"must be {form}", k.tolist(), "Is it transposed?")
    if k[2, 2] != 1:
        raise errors.refuse(name, f"must be {form}", k.tolist(), "Divide by its last number.")
    if k[1, 0] or abs(k[0, 1]) > 1e-6 * abs(k[0, 0]):
        raise errors.refuse(name, f"must be {form}", k.tolist(), "Rectify the image first.")
    if min(k[0, 0], k[1, 1]) <= 1:
        raise errors.refuse(
            name, "must have focal lengths > 1 px", k.tolist(), "Is it normalised, or inverted?"
        )
    return k


def _refuse_hidden_pattern(sensor: Sensor, values: Mapping[str, Any]) -> None:
    """Refuse a pattern without effect because all emitters have their own."""
    emitters = sensor.projector.emitters
    if "projector.pattern" in values and emitters and all(emitter.pattern for emitter in emitters):
        raise errors.refuse(
            "projector.pattern",
            "must not be set where every emitter has its own",
            repr(values["projector.pattern"]),
            "Set projector.emitters=[] too, or projector.emitters.0.pattern.",
        )


def _stock_matcher(name: Any) -> matcher.Matcher:
    try:
        return matcher.named(name)
    except errors.InputError as error:
        _, must, rest = str(error).partition(" must ")
        raise errors.InputError(f"matcher.setting{must}{rest}") from error


def _as_typed(message: str, paths: Iterable[str]) -> str:
    """Replace `left` by `imager` in a message if the user edited `imager`."""
    heads = {path.partition(".")[0] for path in paths}
    if "imager" not in heads or "left" in heads:
        return message
    return re.sub(r"^(key in )?left\b", r"\1imager", message)


def _set(table: dict[str, Any], path: str, value: Any, *, typed: str) -> None:
    """Set one key. `from_table` refuses unknown keys later."""
    *folders, last = path.split(".")
    for depth, name in enumerate(folders, 1):
        holder, table = table, table.setdefault(name, {})
        if isinstance(table, list) and depth == len(folders) and last in _AXES[: len(table)]:
            # A copy, because both imagers may share one list.
            holder[name] = [
                value if axis == last else old for axis, old in zip(_AXES, table, strict=False)
            ]
            return
        if isinstance(table, list) and table and all(isinstance(item, dict) for item in table):
            number = folders[depth] if depth < len(folders) else last
            known = [str(i) for i in range(len(table))]
            errors.one_of(f"number in {'.'.join(folders[:depth])}", number, known)
            table = {str(i): item for i, item in enumerate(table)}
            _set(table, ".".join([*folders[depth:], last]), value, typed=typed)
            holder[name] = list(table.values())
            return
        if not isinstance(table, dict):
            rest = ".".join([*folders[depth:], last])
            raise errors.refuse(
                ".".join(folders[:depth]), "has no fields", f".{rest}", "Drop the last part."
            )
    old = table.get(last)
    if isinstance(old, Mapping):  # A table would reset its missing fields to the defaults.
        raise errors.refuse(
            typed,
            "must be set field by field",
            repr(value),
            f"Its fields: {', '.join(f'{typed}.{field}' for field in old)}.",
        )
    if folders and last == "kind" and value != old:
        table.clear()  # The fields of another kind start from their defaults.
    table[last] = value


def _parse(edit: str) -> tuple[str, Any]:
    path, equals, text = (part.strip() for part in edit.partition("="))
    if not (equals and text and all(part.strip() for part in path.split("."))):
        raise errors.refuse(
            "--set", "must be PATH=VALUE", repr(edit), "Example: --set projector.power_w=0.2."
        )
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        if _BARE_WORD.fullmatch(text):  # The shell removes quotes.
            return path, text
        table = {}
    if list(table) != ["value"]:
        raise errors.refuse(f"--set {path}", "must be a TOML value", repr(text), "Quote text.")
    structure.refuse_long_integers(table["value"], path)
    return path, table["value"]
