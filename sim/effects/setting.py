"""Setting of effects on a sensor and a scene, and reading of their current values."""

from __future__ import annotations

import dataclasses
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from typing import Any

from starling.patterns import errors
from starling.sim import effects
from starling.sim.effects.effect import Effect, Parameter, Value, written
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits, overlaps, structure
from starling.sim.sensor.sensor import Sensor

_SCENE = "scene."
_AXES = ("x", "y", "z")


def apply(sensor: Sensor, scene: Scene, settings: Mapping[str, Value]) -> tuple[Sensor, Scene]:
    """Set effects; other fields stay as they are.

    Args:
        sensor: sensor to start from.
        scene: scene to start from.
        settings: values by `NAME` (the row's first parameter) or `NAME.PARAMETER`.

    Raises:
        InputError: if an effect or parameter is unknown, two effects set one field to different
            values, or a field refuses the value.

    Example:
        >>> apply(sensor, scene, {"lens_blur": 0.8, "motion.y": 0.1})  # doctest: +SKIP
    """
    return on_sensor(sensor, settings), on_scene(scene, settings)


def on_sensor(sensor: Sensor, settings: Mapping[str, Value]) -> Sensor:
    """Set the effects that act on a sensor (see `apply`)."""
    changes = {
        path: change for path, change in _changes(settings).items() if not path.startswith(_SCENE)
    }
    for path, (name, _) in changes.items():
        _refuse_missing(sensor, path, name)
    with _naming({path: name for path, (name, _) in changes.items()}):
        values = [
            (path, _typed(_field(sensor, path), new, path)) for path, (_, new) in changes.items()
        ]
        return edits.with_values(sensor, values)


def acts_on_scene_only(name: str) -> bool:
    """Return whether an effect, or one parameter of it, sets no field of a sensor."""
    return all(path.startswith(_SCENE) for path in parameter_of(name)[1].paths)


def on_scene(scene: Scene, settings: Mapping[str, Value]) -> Scene:
    """Set the effects that act on a scene (see `apply`)."""
    for path, (name, new) in _changes(settings).items():
        if path.startswith(_SCENE):
            with _naming({path: name}):
                scene = _in_scene(scene, path.removeprefix(_SCENE), new)
    return scene


def _changes(settings: Mapping[str, Value]) -> dict[str, tuple[str, Value]]:
    """Return the effect's name and the new value by path."""
    changes: dict[str, tuple[str, Value]] = {}
    for name, new in checked(settings).items():
        effect, parameter = parameter_of(name)
        new = _admitted(effect, parameter, new)
        for path in chain.from_iterable(map(overlaps.spread, parameter.paths)):
            first_name, first_value = changes.setdefault(path, (name, new))
            if first_value != new:
                raise errors.refuse(
                    f"effects {first_name} and {name}",
                    f"must not set {path} to two values",
                    f"{first_value} and {new}",
                    "Drop one of them.",
                )
    return changes


def checked(settings: object) -> Mapping[str, Value]:
    """Check that settings are strengths by name, and return them.

    Raises:
        InputError: if they are no mapping, or a name is no text.
    """
    advice = "Give {NAME: STRENGTH}, such as {'lens_blur': 0.8}."
    table = errors.instance("effects", settings, Mapping, advice)
    for name in table:
        errors.instance("name of an effect", name, str, advice)
    return {name: errors.plain(strength) for name, strength in table.items()}


def warn_of_edits(settings: Mapping[str, Value], paths: Iterable[str]) -> None:
    """Warn of edits of a sensor, by path, whose field an effect sets."""
    for path in paths:
        for name in settings:
            if overlaps.replaced(path, parameter_of(name)[1].paths):
                message = f"effect {name} sets {path} as well, and wins over the edit."
                warnings.warn(message, stacklevel=2)


def value(parameter: Parameter, sensor: Sensor, scene: Scene | None = None) -> Value | None:
    """Return the current value of a parameter.

    It is None if the sensor has no such field (other matchers have other fields). It is also None
    if the field belongs to the scene and `scene` is None.
    """
    path = overlaps.spread(parameter.paths[0])[0]
    tree = scene if path.startswith(_SCENE) else sensor
    if tree is None:
        return None
    try:
        current = _field(tree, path.removeprefix(_SCENE))
    except errors.InputError:
        return None
    return current if isinstance(current, str) else float(current)


def whole(parameter: Parameter, sensor: Sensor) -> bool:
    """Return whether a parameter's field accepts only whole numbers."""
    path = overlaps.spread(parameter.paths[0])[0]
    if path.startswith(_SCENE):
        return False
    try:
        return type(_field(sensor, path)) is int
    except errors.InputError:
        return False


def neutral(parameter: Parameter, sensor: Sensor, scene: Scene | None = None) -> Value | None:
    """Return a parameter's neutral value: the ideal, or the current value if there is no ideal."""
    if parameter.neutral is None:
        return value(parameter, sensor, scene)
    return parameter.neutral


def ideal(sensor: Sensor, scene: Scene) -> tuple[Sensor, Scene]:
    """Set every parameter that has an ideal value to that value."""
    settings = {
        f"{effect.name}.{parameter.name}": parameter.neutral
        for effect in effects.table()
        for parameter in effect.parameters
        if parameter.neutral is not None
    }
    return apply(sensor, scene, settings)


def parse(texts: Iterable[str]) -> dict[str, Value]:
    """Parse texts of the form `NAME[.PARAMETER]=VALUE`.

    Raises:
        InputError: if a text has another form, or a parameter occurs twice.
    """
    settings: dict[str, Value] = {}
    for text in texts:
        name, equals, word = (part.strip() for part in text.partition("="))
        if not (name and equals and word):
            raise errors.refuse(
                "--effect", "must be NAME[.PARAM]=VALUE", repr(text), "Example: lens_blur=0.8."
            )
        if name in settings:
            raise errors.refuse("--effect", "must name a parameter once", name, "Drop one.")
        try:
            settings[name] = float(word)
        except ValueError:
            settings[name] = word
    return settings


def parameter_of(specifier: str) -> tuple[Effect, Parameter]:
    """Return the row and the parameter of `NAME` or `NAME.PARAMETER`.

    Raises:
        InputError: if either is unknown; the message starts with the most similar name.
    """
    name, dot, part = specifier.partition(".")
    effect = effects.named(name)
    if not dot:
        return effect, effect.parameters[0]
    known = {parameter.name: parameter for parameter in effect.parameters}
    errors.one_of(f"parameter of {name}", part, known)
    return effect, known[part]


def _admitted(effect: Effect, parameter: Parameter, new: Value) -> Value:
    """Check a value: a finite number, or one of the choices."""
    name = f"{effect.name}.{parameter.name}"
    if parameter.choices:
        if not (isinstance(new, str) or errors.is_number(new)) or new not in parameter.choices:
            known = ", ".join(map(written, parameter.choices))
            raise errors.refuse(name, f"must be one of {known}", new, "Choose one of them.")
    elif not errors.is_number(new) or not abs(new) <= sys.float_info.max:
        raise errors.refuse(name, "must be a number", repr(new), f"Its unit is {parameter.unit}.")
    return new


def _in_scene(scene: Scene, path: str, new: Value) -> Scene:
    holder, _, axis = path.rpartition(".")
    if axis not in _AXES:
        return structure.edit(scene, path, new)
    old = _field(scene, holder)
    return structure.edit(
        scene, holder, [new if a == axis else o for a, o in zip(_AXES, old, strict=True)]
    )


def _field(tree: Any, path: str) -> Any:
    """Return the field at a dotted path.

    Raises:
        InputError: if there is no such field.
    """
    for name in path.split("."):
        if isinstance(tree, tuple):
            return tree[_AXES.index(name)]
        known = [field.name for field in dataclasses.fields(tree)]
        errors.one_of(f"field of {type(tree).__name__}", name, known)
        tree = getattr(tree, name)
    return tree


def _refuse_missing(sensor: Sensor, path: str, name: str) -> None:
    """Refuse an effect on a field that the sensor lacks; other matchers have other fields."""
    try:
        _field(sensor, path)
    except errors.InputError as error:
        raise errors.refuse(
            f"effect {name}",
            f"needs a sensor with {path}",
            f"{sensor.name} with {type(sensor.matcher.engine).__name__}",
            "Set matcher.setting to d4xx, which has it.",
        ) from error


def _typed(old: Any, new: Value, path: str) -> Any:
    """Convert a number to the field's type."""
    if isinstance(old, bool):
        return bool(new)
    if isinstance(old, int) and not isinstance(new, str):
        if new != int(new):
            raise errors.refuse(path, "must be a whole number", new, "Round it.")
        return int(new)
    return new


@contextmanager
def _naming(names_by_path: Mapping[str, str]) -> Iterator[None]:
    """Prefix errors of the fields with the effects' names; `names_by_path` maps path to name."""
    try:
        yield
    except errors.InputError as error:
        blamed = [name for path, name in names_by_path.items() if _speaks_of(path, str(error))]
        names = ", ".join(dict.fromkeys(blamed or names_by_path.values()))
        raise errors.InputError(f"effect {names}: {error}") from error


def _speaks_of(path: str, message: str) -> bool:
    """Return whether an error message names the last field of a path."""
    *_, field = (part for part in path.split(".") if part not in _AXES)
    return re.search(rf"\b{field}\b", message) is not None
