"""Diagnosis of the sim-to-real gap: where it is, which effects explain it, how far it closes."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """Import `diagnose` on first use, because the import takes seconds."""
    if name == "diagnose":
        from starling.diagnosis.diagnosis import diagnose

        return diagnose
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
