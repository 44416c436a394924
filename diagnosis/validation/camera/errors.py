"""The one way in which this package refuses."""

from __future__ import annotations


class WithheldError(ValueError):
    """Something given to this package cannot be used; the message is one line."""


def refusal(name: str, rule: str, got: object, advice: str) -> WithheldError:
    """Make the error `<name> <rule>; got <value>. <what to do>`.

    Args:
        name: What was refused.
        rule: What holds for it: "must be > 0".
        got: What it was.
        advice: What to do, a whole sentence.

    Returns:
        The error, to be raised by the caller.
    """
    return WithheldError(f"{name} {rule}; got {got}. {advice}")
