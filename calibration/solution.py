"""Fitted parameters with their uncertainty, and sentences on unidentifiable parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Estimate:
    """One fitted parameter."""

    name: str  # As in `parameters.TABLE`; a parameter of one scene is `pattern_scale[SCENE]`.
    value: float
    sd: float  # Standard deviation; inf where the captures do not determine it.
    unit: str
    start: float  # Initial value.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution:
    """Result of one fit."""

    estimates: tuple[Estimate, ...]
    covariance: NDArray[np.float64]  # (n, n) of the estimates, in their order and units.
    # One sentence each: an unidentifiable parameter, and the capture that would determine it.
    undetermined: tuple[str, ...]
    # Mean squared residual at each step, robust if the fit is robust. In pattern and level fits,
    # 1 means sensor noise alone. Geometry fits scale their residuals, so their last value is 1.
    cost: tuple[float, ...]
    sensor: Sensor  # With the estimates set.
    # Combinations that may be determined although their factors are not, such as f * b.
    derived: tuple[Estimate, ...] = ()
    scenes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # Values by scene.

    @property
    def correlation(self) -> NDArray[np.float64]:
        """(n, n) correlation of the estimates; 0 for an unidentifiable parameter."""
        deviation = np.sqrt(np.diagonal(self.covariance))
        safe = np.where(np.isfinite(deviation) & (deviation > 0), deviation, np.inf)
        with np.errstate(invalid="ignore"):
            return np.nan_to_num(self.covariance / np.outer(safe, safe), nan=0.0)
