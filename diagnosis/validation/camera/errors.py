"""Errors of the validation package."""

from __future__ import annotations


class WithheldError(ValueError):
    """An input of this package is invalid. The message is one line."""


def refusal(name: str, rule: str, got: object, advice: str) -> WithheldError:
    """Make the error `<name> <rule>; got <value>. <what to do>`.

    Args:
        name: Name of the invalid input.
        rule: Rule that the input violates, for example "must be > 0".
        got: Value of the input.
        advice: What the user can do, as a whole sentence.

    Returns:
        The error. The caller raises it.
    """
    return WithheldError(" ".join(f"{name} {rule}; got {got}. {advice}".split()))
