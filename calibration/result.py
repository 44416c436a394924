"""What a calibration returns: the sensor, every solution behind it, and scenes held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from starling.calibration.heldout import Scored
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.solution import Estimate, Solution
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Calibration:
    """What `calibration.fit` returns."""

    sensor: Sensor  # Renders what the camera sees.
    solutions: Mapping[str, Solution]  # By what was fitted: geometry, pattern ...
    warnings: tuple[str, ...]  # What the captures' plausibility says.
    fitted_rooms: tuple[str, ...]
    heldout: tuple[Scored, ...]  # Re-simulated scenes of rooms that the fit has not seen.
    before: tuple[Scored, ...]  # The same by the sensor that the fit began from.
    recovered: Recovered | None  # The pattern, where it was asked for.
    seconds: Mapping[str, float]  # By stage.

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """All fitted numbers, those of one scene alone included."""
        return tuple(one for solution in self.solutions.values() for one in solution.estimates)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """What the captures leave open, one sentence each."""
        return tuple(text for solution in self.solutions.values() for text in solution.undetermined)
