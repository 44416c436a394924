"""Fit the target level of auto exposure to the mean levels of captures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.calibration.observation import Observation
from starling.calibration.solution import Estimate, Solution
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor

NAME = "left.auto_exposure_level"
_LEAST_SCENES = 2  # Minimum number of scenes for an estimate of their scatter.


def fit_exposure_level(observations: Sequence[Observation], sensor: Sensor) -> Solution | None:
    """Average the mean level of the left images, projector on, over scenes.

    The metering of a device is unknown, so single scenes deviate from its target. Scenes that are
    too dark for the longest exposure bias the result downwards.

    Args:
        observations: scenes with infrared images.
        sensor: sensor in which to set the level of both imagers.

    Returns:
        The level over full scale and the standard error of its mean over scenes. None if the
        exposure is fixed, or if there are fewer than two scenes.
    """
    if sensor.left.auto_exposure_level == 0:
        return None
    levels = [
        float(observation.left.mean())
        for observation in observations
        if observation.left is not None
    ]
    if len(levels) < _LEAST_SCENES:
        return None
    shares = np.array(levels) / sensor.left.ceiling_dn
    level, spread = float(shares.mean()), float(shares.std(ddof=1))
    deviation = spread / np.sqrt(len(shares))
    return Solution(
        estimates=(
            Estimate(
                name=NAME,
                value=level,
                sd=deviation,
                unit="1",
                start=sensor.left.auto_exposure_level,
            ),
        ),
        covariance=np.array([[deviation**2]]),
        undetermined=(),
        cost=(),
        sensor=edits.with_values(sensor, [("imager.auto_exposure_level", level)]),
    )
