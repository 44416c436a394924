"""Conversion of frozen dataclass trees to and from plain tables and TOML, and edits by path.

In a union of dataclasses the key `kind` holds the class's name.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, TypeVar

from starling.patterns import errors

T = TypeVar("T")

_INTEGER_BITS = 64  # TOML's limit. Longer integers overflow floats or cannot be printed.


def to_table(tree: Any) -> dict[str, Any]:
    """Convert a dataclass tree to nested tables of plain values; None is omitted."""
    table: dict[str, Any] = {}
    hints = _hints(type(tree))
    for field in dataclasses.fields(tree):
        value = getattr(tree, field.name)
        if value is None:
            continue
        if dataclasses.is_dataclass(value):
            inner = to_table(value)
            if len(_classes(hints[field.name])) > 1:
                inner = {"kind": type(value).__name__, **inner}
            table[field.name] = inner
        elif isinstance(value, tuple):
            table[field.name] = [
                to_table(item) if dataclasses.is_dataclass(item) else errors.plain(item)
                for item in value
            ]
        else:
            table[field.name] = errors.plain(value)
    return table


def from_table(cls: type[T], table: Mapping[str, Any], name: str = "") -> T:
    """Build a dataclass tree from nested tables.

    Args:
        cls: Dataclass to build.
        table: Values by field name.
        name: Dotted path of the table, for error messages.

    Raises:
        InputError: for an unknown key, a missing key, a wrong type, or a value that the dataclass
            refuses. The message lists the known keys, nearest first.
    """
    if not isinstance(table, Mapping):
        raise errors.refuse(
            name or cls.__name__, "must be a table", repr(table), "Give key = value."
        )
    hints = _hints(cls)
    for key in table:
        errors.one_of(f"key in {name}" if name else "key", key, hints)
    values = {key: _value(hints[key], value, _join(name, key)) for key, value in table.items()}
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        optional = (
            field.default is not dataclasses.MISSING
            or field.default_factory is not dataclasses.MISSING
        )
        if not optional and field.name not in values:
            raise errors.refuse(_join(name, field.name), "must be given", "nothing", "Add the key.")
    return cls(**values)


def edit(tree: T, path: str, value: Any, name: str = "") -> T:
    """Return the tree with the field at a dotted path replaced.

    Args:
        tree: Dataclass tree.
        path: Dotted path, e.g. `projector.power_w`.
        value: Plain value as in TOML.
        name: Dotted path of the tree, for error messages.

    Raises:
        InputError: for an unknown path or a refused value.
    """
    head, _, rest = path.partition(".")
    hints = _hints(type(tree))
    errors.one_of(f"field in {name}" if name else "field", head, hints)
    old = getattr(tree, head)
    if rest:
        if not dataclasses.is_dataclass(old):
            raise errors.refuse(
                _join(name, head), "has no fields", f".{rest}", "Drop the last part."
            )
        new = edit(old, rest, value, _join(name, head))
    else:
        new = _value(hints[head], value, _join(name, head))
    return dataclasses.replace(tree, **{head: new})  # type: ignore[type-var]


def merged(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge changes into a table without validating it.

    Args:
        table: Nested tables.
        changes: Tables, or values by dotted path. A table with a `kind` replaces a part.
    """
    result = dict(table)
    for path, value in changes.items():
        name, _, rest = path.partition(".")
        new, old = {rest: value} if rest else value, result.get(name)
        if isinstance(new, Mapping) and isinstance(old, Mapping) and "kind" not in new:
            new = merged(old, new)
        result[name] = new
    return result


@cache
def _hints(cls: type) -> dict[str, Any]:
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def _join(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


def _classes(hint: Any) -> list[type]:
    """Return the dataclasses in a type hint."""
    options = typing.get_args(hint) if _is_union(hint) else (hint,)
    return [option for option in options if dataclasses.is_dataclass(option)]  # type: ignore[misc]


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def refuse_long_integers(value: Any, name: str) -> None:
    """Refuse integers over 64 bits, also in nested lists and tables.

    Raises:
        InputError: with the integer's path; the message omits the digits.
    """
    for place, number in _integers(value, name):
        bits = number.bit_length()
        if bits >= _INTEGER_BITS:
            raise errors.refuse(
                place,
                f"must fit in {_INTEGER_BITS} bits",
                f"a whole number of {bits + 1} bits",
                "Give a smaller one.",
            )


def _integers(value: Any, name: str) -> Iterator[tuple[str, int]]:
    if isinstance(value, int):
        yield name, value
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _integers(item, name)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _integers(item, _join(name, str(key)))


def _value(hint: Any, value: Any, name: str) -> Any:
    refuse_long_integers(value, name)
    classes = _classes(hint)
    if classes:
        return _tree(classes, value, name)
    if _is_union(hint):  # Optional plain value: TOML has no null, so any value is set.
        hint = next(option for option in typing.get_args(hint) if option is not types.NoneType)
    origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return _choice(typing.get_args(hint), value, name)
    if origin is tuple:
        kinds = typing.get_args(hint)
        if kinds[1:] == (Ellipsis,):
            if not isinstance(value, (list, tuple)):
                raise errors.refuse(name, "must be a list", repr(value), "Give [] for none.")
            return tuple(_value(kinds[0], item, f"{name}.{i}") for i, item in enumerate(value))
        if not isinstance(value, (list, tuple)) or len(value) != len(kinds):
            raise errors.refuse(
                name, f"must be a list of {len(kinds)}", repr(value), "Give all components."
            )
        return tuple(_value(kind, item, name) for kind, item in zip(kinds, value, strict=True))
    return _scalar(hint, value, name)


def _choice(options: tuple[Any, ...], value: Any, name: str) -> Any:
    if all(isinstance(option, str) for option in options):
        errors.one_of(name, value, options)
    elif not any(type(value) is type(option) and value == option for option in options):
        listed = ", ".join(map(repr, options))
        raise errors.refuse(name, f"must be one of {listed}", repr(value), "Choose one of them.")
    return value


def _tree(classes: list[type], value: Any, name: str) -> Any:
    if not isinstance(value, Mapping):
        raise errors.refuse(name, "must be a table", repr(value), "Give key = value.")
    if len(classes) == 1:
        return from_table(classes[0], value, name)
    known = {cls.__name__: cls for cls in classes}
    errors.one_of(f"{name}.kind", value.get("kind"), known)
    rest = {key: item for key, item in value.items() if key != "kind"}
    return from_table(known[value["kind"]], rest, name)


def _scalar(hint: type, value: Any, name: str) -> Any:
    value = errors.plain(value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not hint:
        raise errors.refuse(
            name, f"must be of type {hint.__name__}", repr(value), "Write it as such in the file."
        )
    return value
