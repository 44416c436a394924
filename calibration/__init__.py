"""Fit a sensor (geometry, projector, pattern, photometry) to captures, with uncertainty."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """Load `fit` when it is asked for: it takes seconds, the package must not."""
    if name == "fit":
        from starling.calibration.fit_sensor import fit

        return fit
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
