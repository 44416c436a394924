"""Prediction methods by name. The packages of a method are imported when it is created."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from pathlib import Path
from typing import Any

from starling.learning.method import Method
from starling.patterns import errors

# Module under `starling.learning.methods`, class, and its options.
_TABLE: dict[str, tuple[str, str, dict[str, Any]]] = {
    "perfect": ("baselines", "Perfect", {}),
    "simple": ("baselines", "Simple", {}),
    "trees": ("trees", "Trees", {}),
    "trees_reflectance": ("trees", "Trees", {"with_reflectance": True}),
    "hybrid_trees": ("trees", "Trees", {"with_physics": True}),
    "physics": ("physics", "Simulated", {}),
    "physics_recalibrated": ("physics", "Simulated", {"recalibrated": True}),
    "network": ("network", "Network", {}),
    "network_reflectance": ("network", "Network", {"with_reflectance": True}),
    "hybrid": ("network", "Hybrid", {}),
    "hybrid_reflectance": ("network", "Hybrid", {"with_reflectance": True}),
    "pix2pix": ("pix2pix", "Pix2Pix", {}),
    "cyclegan": ("cyclegan", "CycleGan", {}),
}
NAMES = tuple(_TABLE)
ON_PHYSICS = frozenset(
    {"physics", "physics_recalibrated", "hybrid", "hybrid_reflectance", "hybrid_trees"}
)
STARTABLE = frozenset({"network", "network_reflectance", "hybrid", "hybrid_reflectance"})
# Changed settings for a network with initial weights.
_FINE_TUNING: dict[str, Any] = {"steps": 60, "rate": 1e-3}


def method(name: str, *, steps: int | None = None, start: Path | None = None) -> Method:
    """Create a method.

    Args:
        name: one of `NAMES`.
        steps: training steps of a network; None uses its default. Ignored by other methods.
        start: folder in which `starling train` saved the same method, as initial weights; training
            then uses fewer and smaller steps. None starts from scratch.

    Raises:
        InputError: if there is no such method, it cannot start from weights, steps is below 1, or a
            required package is missing.
    """
    errors.one_of("method", name, NAMES)
    module, kind, options = _TABLE[name]
    try:
        instance = getattr(import_module(f"starling.learning.methods.{module}"), kind)(**options)
    except ModuleNotFoundError as error:
        raise errors.needs(name, str(error.name), "learning") from error
    if start is not None and name not in STARTABLE:
        known = ", ".join(sorted(STARTABLE))
        raise errors.refuse("start", f"must be for one of {known}", name, "Leave it out.")
    if steps is not None:
        errors.whole_number("steps", steps, 1, 10**9)
    changed: dict[str, Any] = {} if start is None else {"start": start, **_FINE_TUNING}
    if steps is not None:
        changed["steps"] = steps
    if not (changed and hasattr(instance, "settings")):
        return instance
    return dataclasses.replace(instance, settings=dataclasses.replace(instance.settings, **changed))
