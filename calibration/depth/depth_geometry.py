"""Fit scale and offset of a device's disparity by repeated simulation (indirect inference)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from starling.calibration.depth import disparity_scale
from starling.calibration.depth.depth_twin import DepthTwin
from starling.calibration.depth.disparity_scale import DisparityScale
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.sensor.sensor import Sensor

_MORE = 3  # Maximum steps after the first; each step renders all scenes once.
_SETTLED = 0.2  # Change of geometry below which steps end [standard deviations].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthGeometry:
    """Result of the steps."""

    sensor: Sensor  # With `baseline_error` and the right image's offset set.
    twins: tuple[DepthTwin, ...]  # Rendered with that sensor.
    last: DisparityScale  # Correction of the last step, with its covariance.


def fit_by_simulation(
    twins: Sequence[DepthTwin],
    sensor: Sensor,
    free: Sequence[str],
    *,
    track: progress.Progress = progress.silent,
) -> DepthGeometry:
    """Correct scale and offset until simulated and device disparity agree.

    A matcher biases disparity by up to 0.1 px, depending on its fraction, slope and surroundings.
    The simulation of the same scene has the same bias, so the difference has little of it.
    Source of the method (indirect inference): Gourieroux, Monfort and Renault 1993, Journal of
    Applied Econometrics 8.

    Args:
        twins: scenes rendered with the sensor.
        sensor: initial sensor.
        free: `scale`, `offset` or both.
        track: progress callback around the steps.

    Raises:
        InputError: as `disparity_scale.fit`, or if a value leaves the sensor's range.
    """
    geometry = _step(twins, sensor, free)
    for _ in track(range(_MORE), "geometry"):
        change = np.array([geometry.last.scale, geometry.last.offset_px])
        if (np.abs(change) <= _SETTLED * np.sqrt(np.diagonal(geometry.last.covariance))).all():
            break
        geometry = _step(geometry.twins, geometry.sensor, free)
    return geometry


def _step(twins: Sequence[DepthTwin], sensor: Sensor, free: Sequence[str]) -> DepthGeometry:
    correction = disparity_scale.fit(
        [depth_twin.pair_with(depth_twin.reading(sensor)) for depth_twin in twins], free=free
    )
    corrected = setting.on_sensor(
        sensor,
        {
            "baseline_error": sensor.baseline_error + correction.scale,
            "disparity_offset": sensor.right.alignment.offset_x_px - correction.offset_px,
        },
    )
    return DepthGeometry(
        sensor=corrected,
        twins=tuple(depth_twin.rendered(corrected) for depth_twin in twins),
        last=correction,
    )
