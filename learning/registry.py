"""The methods by name; what one of them needs is loaded when it is asked for."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from typing import Any

from learning.method import Method
from patterns import errors

# Module under `learning.methods`, class, and its options.
_TABLE: dict[str, tuple[str, str, dict[str, Any]]] = {
    "perfect": ("perfect", "Perfect", {}),
    "simple": ("simple", "Simple", {}),
    "trees": ("trees", "Trees", {}),
    "trees_reflectance": ("trees", "Trees", {"with_reflectance": True}),
    "physics": ("physics", "Simulated", {}),
    "physics_recalibrated": ("physics", "Simulated", {"recalibrated": True}),
    "network": ("network", "Network", {}),
    "network_reflectance": ("network", "Network", {"with_reflectance": True}),
    "hybrid": ("hybrid", "Hybrid", {}),
    "hybrid_reflectance": ("hybrid", "Hybrid", {"with_reflectance": True}),
    "pix2pix": ("pix2pix", "Pix2Pix", {}),
    "cyclegan": ("cyclegan", "CycleGan", {}),
}
NAMES = tuple(_TABLE)
ON_PHYSICS = frozenset({"physics", "physics_recalibrated", "hybrid", "hybrid_reflectance"})


def method(name: str, *, steps: int | None = None) -> Method:
    """Make a method.

    Args:
        name: of `NAMES`.
        steps: how long a network is trained; None leaves its own number. Others have no steps.

    Raises:
        InputError: if there is no such method, or steps is below 1.
    """
    errors.one_of("method", name, NAMES)
    module, kind, options = _TABLE[name]
    made = getattr(import_module(f"learning.methods.{module}"), kind)(**options)
    if steps is None or not hasattr(made, "settings"):
        return made
    return dataclasses.replace(made, settings=dataclasses.replace(made.settings, steps=steps))
