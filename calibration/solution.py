"""A fitted set of parameters with their uncertainty, and what the captures leave open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Estimate:
    """One fitted number."""

    name: str  # As in the table of parameters; of one scene alone: `pattern_scale[SCENE]`.
    value: float
    sd: float  # Standard deviation; inf where the captures do not determine it.
    unit: str
    start: float  # Where the fit began.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution:
    """Where a fit ended."""

    estimates: tuple[Estimate, ...]
    covariance: NDArray[np.float64]  # (n, n) of the estimates, in their order and units.
    undetermined: tuple[str, ...]  # One sentence each: what cannot be told, and what would tell it.
    # Mean squared residual at each step, robust where the fit is. Of patterns and levels 1 is the
    # sensor's noise alone; of geometry, whose residuals set their own deviations, the last is 1.
    cost: tuple[float, ...]
    sensor: Sensor  # With the estimates set.
    # Combinations that may be determined where their parts are not: f b, for one.
    derived: tuple[Estimate, ...] = ()
    scenes: Mapping[str, Mapping[str, float]] = field(
        default_factory=dict
    )  # What differs by scene.

    @property
    def correlation(self) -> NDArray[np.float64]:
        """(n, n) correlation of the estimates; 0 beside one that is not determined."""
        deviation = np.sqrt(np.diagonal(self.covariance))
        safe = np.where(np.isfinite(deviation) & (deviation > 0), deviation, np.inf)
        with np.errstate(invalid="ignore"):
            return np.nan_to_num(self.covariance / np.outer(safe, safe), nan=0.0)
