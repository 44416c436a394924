"""The result of a calibration: the sensor, the solution of each fit, and held-out scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from starling.calibration.heldout import SceneScore
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.solution import Estimate, Solution
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Calibration:
    """Result of `calibration.fit`."""

    sensor: Sensor  # The calibrated sensor.
    solutions: Mapping[str, Solution]  # By fit: geometry, pattern ...
    warnings: tuple[str, ...]  # From the plausibility checks of the captures.
    fitted_rooms: tuple[str, ...]
    heldout: tuple[SceneScore, ...]  # Held-out scenes, simulated with the fitted sensor.
    before: tuple[SceneScore, ...]  # The same scenes, simulated with the initial sensor.
    recovered: RecoveredPattern | None  # The pattern, if the fit freed it.
    seconds: Mapping[str, float]  # Wall time by stage [s].

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """All fitted parameters, including those of single scenes."""
        return tuple(
            estimate for solution in self.solutions.values() for estimate in solution.estimates
        )

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Unidentifiable parameters, one sentence each."""
        return tuple(text for solution in self.solutions.values() for text in solution.undetermined)
