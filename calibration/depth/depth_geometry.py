"""Scale and offset of a device's disparity, found by simulating what is seen until both agree."""

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

_MORE = 3  # Steps after the first, at most; each renders every scene once.
_SETTLED = 0.2  # Of its standard deviation: a smaller change of geometry ends the steps.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthGeometry:
    """Where the steps ended."""

    sensor: Sensor  # With `baseline_error` and the right image's offset set.
    twins: tuple[DepthTwin, ...]  # Rendered by it.
    last: DisparityScale  # The last step: what was added, and with which covariance.


def settle(
    twins: Sequence[DepthTwin],
    sensor: Sensor,
    free: Sequence[str],
    *,
    track: progress.Progress = progress.silent,
) -> DepthGeometry:
    """Add to scale and offset what the device's disparity has beyond the simulated one.

    A matcher pulls disparities by up to a tenth of a pixel with their fraction, slope and
    surroundings. The same scene simulated has the same pull, so the difference has little of it.
    Source of the idea, indirect inference: Gourieroux, Monfort and Renault 1993, Journal of
    Applied Econometrics 8.

    Args:
        twins: rendered by the sensor.
        sensor: to start from.
        free: `scale`, `offset` or both.
        track: wraps the steps.

    Raises:
        InputError: as `disparity_scale.fit`, or an error beyond the sensor's range.
    """
    at = _step(twins, sensor, free)
    for _ in track(range(_MORE), "geometry"):
        change = np.array([at.last.scale, at.last.offset_px])
        if (np.abs(change) <= _SETTLED * np.sqrt(np.diagonal(at.last.covariance))).all():
            break
        at = _step(at.twins, at.sensor, free)
    return at


def _step(twins: Sequence[DepthTwin], sensor: Sensor, free: Sequence[str]) -> DepthGeometry:
    found = disparity_scale.fit([one.beside(one.reading(sensor)) for one in twins], free=free)
    moved = setting.on_sensor(
        sensor,
        {
            "baseline_error": sensor.baseline_error + found.scale,
            "disparity_offset": sensor.right.alignment.offset_x_px - found.offset_px,
        },
    )
    return DepthGeometry(
        sensor=moved, twins=tuple(one.rendered(moved) for one in twins), last=found
    )
