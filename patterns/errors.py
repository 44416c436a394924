"""The one refusal of the whole project and the checks that raise it.

Form of every message: `<name> <rule>; got <value>. <what to do>` on one line.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Iterable


class InputError(ValueError):
    """Input that is refused: the message is one line that says what to do."""


def refuse(name: str, rule: str, value: object, remedy: str) -> InputError:
    """Build (not raise) the refusal `<name> <rule>; got <value>. <remedy>` on one line."""
    text = f"{name} {rule}; got {value}. {remedy}"
    return InputError(" ".join(text.split()))


def needs(name: str, package: str, extra: str) -> InputError:
    """Build (not raise) the refusal of what an optional package is missing for.

    Args:
        name: what needs it.
        package: that is not installed.
        extra: of this program, which brings it.
    """
    remedy = f"In the project's folder: pip install -e '.[{extra}]'."
    return refuse(name, f"needs {package}", "none", remedy)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def in_interval(
    name: str, value: float, low: float, high: float, remedy: str = "Choose a value inside."
) -> None:
    """Refuse a value outside the closed interval [low, high], NaN and non-numbers included.

    Raises:
        InputError: if the value is no real number, not finite, or outside.
    """
    # Compared first: a whole number may be too large to ask whether it is finite.
    if not _is_number(value) or not low <= value <= high or not math.isfinite(value):
        raise refuse(name, f"must be in [{low:g}, {high:g}]", repr(value), remedy)


def positive(name: str, value: float, remedy: str = "Give a number above zero.") -> None:
    """Refuse a value that is not a finite number above zero.

    Raises:
        InputError: if the value is no real number, not finite, or <= 0.
    """
    if not _is_number(value) or not 0 < value <= sys.float_info.max:
        raise refuse(name, "must be > 0", repr(value), remedy)


def one_of(name: str, value: object, known: Iterable[str]) -> None:
    """Refuse a name that is not among the known ones; the remedy lists them, nearest first.

    Raises:
        InputError: if `value` is not one of `known`.
    """
    known = sorted(known)
    if value in known:
        return
    near = difflib.get_close_matches(str(value), known, n=len(known), cutoff=0.0)
    listed = ", ".join(near + [name for name in known if name not in near])
    raise refuse(name, "must be a known name", repr(value), f"Known: {listed}.")
