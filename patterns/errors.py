"""The project's input error and the checks that raise it.

Every message has the form `<name> <rule>; got <value>. <what to do>` on one line.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

_LONGEST = 500  # Values longer than this are cut in messages [characters].
_LONGEST_VECTOR = 1e6  # Largest component of a direction, whose length has a limit of its own.


class InputError(ValueError):
    """Refused input. The message is one line that states the remedy."""


def refuse(name: str, rule: str, value: object, remedy: str) -> InputError:
    """Build (not raise) the error `<name> <rule>; got <value>. <remedy>` on one line."""
    got = str(value).removesuffix(".")  # An error message as value ends its own sentence.
    if len(got) > _LONGEST:
        got = f"{got[:_LONGEST]} ... ({len(got)} characters)"
    text = f"{name} {rule}; got {got}. {remedy}"
    return InputError(" ".join(text.split()))


def needs(name: str, package: str, extra: str) -> InputError:
    """Build (not raise) the error for a missing optional package.

    Args:
        name: Feature that needs the package.
        package: Package that is not installed.
        extra: Extra of this project that installs the package.
    """
    remedy = f"In the project's folder: pip install -e '.[{extra}]'."
    return refuse(name, f"needs {package}", "none", remedy)


@contextmanager
def naming(name: object) -> Iterator[None]:
    """Prefix input errors with what they concern: a file, a scene or an entry."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a real number of Python or numpy, and no boolean."""
    kinds = (int, float, np.integer, np.floating)
    return isinstance(value, kinds) and not isinstance(value, bool)


def plain(value: Any) -> Any:
    """Return a number of numpy as Python's number, and other values as they are."""
    if isinstance(value, (np.integer, np.bool_)):
        return value.item()
    return float(value) if isinstance(value, np.floating) else value


def shown(value: object) -> str:
    """Return the text of a value for a message, also of integers that Python does not print."""
    try:
        return repr(value)
    except ValueError:
        return f"a value of type {type(value).__name__} that cannot be printed"


def instance(name: str, value: object, kinds: type[T] | tuple[type[T], ...], remedy: str) -> T:
    """Check the type of a value and return the value.

    Raises:
        InputError: if the value is of no type in `kinds`.
    """
    if isinstance(value, kinds):
        return value
    types = kinds if isinstance(kinds, tuple) else (kinds,)
    listed = " or ".join(kind.__name__ for kind in types)
    raise refuse(name, f"must be of type {listed}", shown(value), remedy)


def unicode_text(name: str, value: object) -> None:
    """Refuse a value that is no text, or text that UTF-8 cannot hold.

    Raises:
        InputError: if the value has another type or holds a lone surrogate.
    """
    try:
        instance(name, value, str, "Give text.").encode()
    except UnicodeEncodeError:
        raise refuse(name, "must be Unicode text", shown(value), "Rename it.") from None


def numbers(name: str, values: Any) -> NDArray[Any]:
    """Return an array of real numbers, NaN where it is masked.

    Args:
        name: name of the values in the user's words.
        values: array, list, or tensor of any library that numpy reads.

    Raises:
        InputError: if the values are no real numbers, or lists of unequal length.
    """
    rule = "must be an array of real numbers"
    try:
        if isinstance(values, np.ma.MaskedArray):
            return np.ma.filled(values.astype(np.float64), np.nan)
        array = np.asarray(values)
    except (TypeError, ValueError, RuntimeError) as error:
        got = f"{type(values).__name__}: {error}"
        raise refuse(name, rule, got, "Convert it to an array of float32.") from error
    if array.dtype.kind not in "fiu":
        raise refuse(name, rule, f"{array.shape} {array.dtype}", "Convert it.")
    return array


def texts(name: str, values: object, remedy: str) -> list[str]:
    """Return a list of texts; one text is no list.

    Raises:
        InputError: if the value has no entries, or an entry has another type.
    """
    if isinstance(values, (str, bytes)):
        values = instance(name, values, list, remedy)
    try:
        entries = list(instance(name, values, Iterable, remedy))
    except TypeError:  # An array of numpy without axes has no entries.
        raise refuse(name, "must be a list", shown(values), remedy) from None
    return [instance(f"entry of {name}", entry, str, remedy) for entry in entries]


def in_interval(
    name: str, value: object, low: float, high: float, remedy: str = "Choose a value inside."
) -> None:
    """Refuse a value outside the closed interval [low, high], NaN and non-numbers included.

    Raises:
        InputError: if the value is not a finite real number, or is outside.
    """
    value = plain(value)
    # The comparison comes first: `math.isfinite` overflows on very large integers.
    if not is_number(value) or not low <= value <= high or not math.isfinite(value):
        raise refuse(name, f"must be in [{low:g}, {high:g}]", shown(value), remedy)


def positive(name: str, value: object, remedy: str = "Give a number above zero.") -> None:
    """Refuse a value that is not a finite number above zero.

    Raises:
        InputError: if the value is not a finite real number, or is <= 0.
    """
    value = plain(value)
    if not is_number(value) or not 0 < value <= sys.float_info.max:
        raise refuse(name, "must be > 0", shown(value), remedy)


def triple(name: str, value: object) -> tuple[Any, Any, Any]:
    """Check that a value is a tuple of three entries and return it.

    Raises:
        InputError: if the value has another type or length.
    """
    if not isinstance(value, tuple) or len(value) != 3:
        raise refuse(name, "must be a tuple of three numbers", shown(value), "Give all three.")
    return value


def vector(
    name: str, value: object, low: float, high: float, remedy: str = "Choose a value inside."
) -> None:
    """Refuse a value that is no tuple of three numbers in the closed interval [low, high].

    Raises:
        InputError: if it has another form, or a number is outside; the message names its axis.
    """
    for axis, number in zip("xyz", triple(name, value), strict=True):
        in_interval(f"{name}.{axis}", number, low, high, remedy)


def direction(name: str, value: object, shortest: float, longest: float, remedy: str) -> None:
    """Refuse a value that is no vector with a length in the closed interval.

    Raises:
        InputError: as `vector`, or if the length is outside.
    """
    vector(name, value, -_LONGEST_VECTOR, _LONGEST_VECTOR, remedy)
    length = math.hypot(*triple(name, value))
    in_interval(f"length of {name}", length, shortest, longest, remedy)


def one_of(name: str, value: object, known: Iterable[str]) -> None:
    """Refuse an unknown name; the remedy lists the known names, nearest first.

    Raises:
        InputError: if `value` is not one of `known`.
    """
    known = sorted(known)
    if isinstance(value, str) and value in known:
        return
    spelling = value if isinstance(value, str) else ""
    near = difflib.get_close_matches(spelling, known, n=len(known), cutoff=0.0)
    listed = ", ".join(near + [name for name in known if name not in near])
    raise refuse(name, "must be a known name", shown(value), f"Known: {listed}.")


def whole_number(
    name: str, value: int, low: int, high: int, remedy: str = "Give a whole number."
) -> int:
    """Check that a value is an integer in [low, high] and return it as `int`.

    Booleans are refused.

    Raises:
        InputError: if `value` is not an integer or is outside.
    """
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not integer or not low <= value <= high:
        raise refuse(name, f"must be an integer in [{low}, {high}]", shown(value), remedy)
    return int(value)


def seeded_generator(seed: int) -> np.random.Generator:
    """Return numpy's PCG64 generator for a checked seed.

    Raises:
        InputError: if the seed is not an integer in [0, 2^63 - 1].
    """
    return np.random.Generator(np.random.PCG64(whole_number("seed", seed, 0, 2**63 - 1)))
