"""Fit a sensor (geometry, projector, pattern, photometry) to captures, with uncertainty."""

from __future__ import annotations

from typing import Any

MOST_SCENES = 40  # Fitted at once; each keeps about 400 bytes a pixel in memory.


def __getattr__(name: str) -> Any:
    """Import `fit` on first access, because its import takes seconds."""
    if name == "fit":
        from starling.calibration.fit_sensor import fit

        return fit
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
