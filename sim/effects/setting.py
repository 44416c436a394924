"""Setting effects on a sensor and a scene, and reading where they stand."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from starling.patterns import errors
from starling.sim import effects
from starling.sim.effects.effect import Effect, Parameter, Value, written
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits, structure
from starling.sim.sensor.sensor import Sensor

_SCENE = "scene."
_BOTH = "imager."
_AXES = ("x", "y", "z")


def apply(sensor: Sensor, scene: Scene, settings: Mapping[str, Value]) -> tuple[Sensor, Scene]:
    """Set effects; what is not named stays as it is.

    Args:
        sensor: to start from.
        scene: likewise.
        settings: value by `NAME` (the row's first parameter) or `NAME.PARAMETER`.

    Raises:
        InputError: unknown effect or parameter (nearest name first), two that set one field to
            different values, or a value that the field refuses.

    Example:
        >>> apply(sensor, scene, {"lens_blur": 0.8, "motion.y": 0.1})  # doctest: +SKIP
    """
    return on_sensor(sensor, settings), on_scene(scene, settings)


def on_sensor(sensor: Sensor, settings: Mapping[str, Value]) -> Sensor:
    """Set those effects that move a sensor (see `apply`)."""
    moved = {path: by for path, by in _moved(settings).items() if not path.startswith(_SCENE)}
    for path, (asked, _) in moved.items():
        _refuse_missing(sensor, path, asked)
    with _naming({path: asked for path, (asked, _) in moved.items()}):
        values = [(path, _typed(_field(sensor, path), to, path)) for path, (_, to) in moved.items()]
        return edits.with_values(sensor, values)


def is_scenes(asked: str) -> bool:
    """Return whether an effect, or one parameter of it, moves nothing of a sensor."""
    return all(path.startswith(_SCENE) for path in parameter_of(asked)[1].paths)


def on_scene(scene: Scene, settings: Mapping[str, Value]) -> Scene:
    """Set those effects that move a scene (see `apply`)."""
    for path, (asked, to) in _moved(settings).items():
        if path.startswith(_SCENE):
            with _naming({path: asked}):
                scene = _in_scene(scene, path.removeprefix(_SCENE), to)
    return scene


def _moved(settings: Mapping[str, Value]) -> dict[str, tuple[str, Value]]:
    """Return by path what was asked for and the value it sets there."""
    moved: dict[str, tuple[str, Value]] = {}
    for asked, to in settings.items():
        effect, parameter = parameter_of(asked)
        to = _admitted(effect, parameter, to)
        for path in _spread(parameter.paths):
            before, other = moved.setdefault(path, (asked, to))
            if other != to:
                raise errors.refuse(
                    f"effects {before} and {asked}",
                    f"must not set {path} to two values",
                    f"{other} and {to}",
                    "Drop one of them.",
                )
    return moved


def value(parameter: Parameter, sensor: Sensor, scene: Scene | None = None) -> Value | None:
    """Return where a parameter stands: the base that an effect departs from.

    None where the sensor has no such field (another matcher's), or no scene is at hand.
    """
    path = _spread(parameter.paths)[0]
    tree = scene if path.startswith(_SCENE) else sensor
    if tree is None:
        return None
    try:
        found = _field(tree, path.removeprefix(_SCENE))
    except errors.InputError:
        return None
    return found if isinstance(found, str) else float(found)


def whole(parameter: Parameter, sensor: Sensor) -> bool:
    """Return whether a parameter's field takes whole numbers alone."""
    path = _spread(parameter.paths)[0]
    if path.startswith(_SCENE):
        return False
    try:
        return type(_field(sensor, path)) is int
    except errors.InputError:
        return False


def neutral(parameter: Parameter, sensor: Sensor, scene: Scene | None = None) -> Value | None:
    """Return a parameter's neutral: the ideal, or where there is none the value at hand."""
    if parameter.neutral is None:
        return value(parameter, sensor, scene)
    return parameter.neutral


def ideal(sensor: Sensor, scene: Scene) -> tuple[Sensor, Scene]:
    """Set every row that has an ideal to it."""
    settings = {
        f"{effect.name}.{parameter.name}": parameter.neutral
        for effect in effects.table()
        for parameter in effect.parameters
        if parameter.neutral is not None
    }
    return apply(sensor, scene, settings)


def parse(texts: Iterable[str]) -> dict[str, Value]:
    """Read `NAME[.PARAMETER]=VALUE` texts.

    Raises:
        InputError: a text of another form, or one parameter given twice.
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


def parameter_of(asked: str) -> tuple[Effect, Parameter]:
    """Return the row and parameter of `NAME` or `NAME.PARAMETER`.

    Raises:
        InputError: unknown ones, nearest name first.
    """
    name, dot, part = asked.partition(".")
    effect = effects.named(name)
    if not dot:
        return effect, effect.parameters[0]
    known = {parameter.name: parameter for parameter in effect.parameters}
    errors.one_of(f"parameter of {name}", part, known)
    return effect, known[part]


def _admitted(effect: Effect, parameter: Parameter, given: Value) -> Value:
    """Refuse words for numbers, what is not finite and what is none of the choices."""
    name = f"{effect.name}.{parameter.name}"
    if parameter.choices:
        if given not in parameter.choices:
            known = ", ".join(map(written, parameter.choices))
            raise errors.refuse(name, f"must be one of {known}", given, "Choose one of them.")
    elif isinstance(given, str) or not math.isfinite(given):
        raise errors.refuse(name, "must be a number", repr(given), f"Its unit is {parameter.unit}.")
    return given


def _spread(paths: Iterable[str]) -> list[str]:
    """Write out what moves both imagers."""
    return [
        side + path.removeprefix(_BOTH) if path.startswith(_BOTH) else path
        for path in paths
        for side in (("left.", "right.") if path.startswith(_BOTH) else ("",))
    ]


def _in_scene(scene: Scene, path: str, given: Value) -> Scene:
    holder, _, axis = path.rpartition(".")
    if axis not in _AXES:
        return structure.edit(scene, path, given)
    old = _field(scene, holder)
    return structure.edit(
        scene, holder, [given if a == axis else o for a, o in zip(_AXES, old, strict=True)]
    )


def _field(tree: Any, path: str) -> Any:
    """Return the field at a dotted path, refusing what is not there."""
    for name in path.split("."):
        if isinstance(tree, tuple):
            return tree[_AXES.index(name)]
        known = [field.name for field in dataclasses.fields(tree)]
        errors.one_of(f"field of {type(tree).__name__}", name, known)
        tree = getattr(tree, name)
    return tree


def _refuse_missing(sensor: Sensor, path: str, asked: str) -> None:
    """Refuse an effect on a field that the sensor lacks: other matchers have other fields."""
    try:
        _field(sensor, path)
    except errors.InputError as error:
        raise errors.refuse(
            f"effect {asked}",
            f"needs a sensor with {path}",
            f"{sensor.name} with {type(sensor.matcher.engine).__name__}",
            "Set matcher.setting to d4xx, which has it.",
        ) from error


def _typed(old: Any, given: Value, path: str) -> Any:
    """Turn a number into the field's own type."""
    if isinstance(old, bool):
        return bool(given)
    if isinstance(old, int) and not isinstance(given, str):
        if given != int(given):
            raise errors.refuse(path, "must be a whole number", given, "Round it.")
        return int(given)
    return given


@contextmanager
def _naming(asked: Mapping[str, str]) -> Iterator[None]:
    """Put the effects' names before what their fields refuse; `asked` has an effect by path."""
    try:
        yield
    except errors.InputError as error:
        blamed = [name for path, name in asked.items() if _speaks_of(path, str(error))]
        names = ", ".join(dict.fromkeys(blamed or asked.values()))
        raise errors.InputError(f"effect {names}: {error}") from error


def _speaks_of(path: str, message: str) -> bool:
    """Whether a refusal names the field that a path ends at."""
    *_, field = (part for part in path.split(".") if part not in _AXES)
    return re.search(rf"\b{field}\b", message) is not None
