"""The sim-to-real gap: where it is, which effect makes it, and how far it can be closed."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """Load `diagnose` when it is asked for: it takes seconds, the package must not."""
    if name == "diagnose":
        from starling.diagnosis.diagnosis import diagnose

        return diagnose
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
