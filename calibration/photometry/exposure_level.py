"""Fit the level that auto exposure aims at, from the mean levels of captures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.calibration.observation import Observation
from starling.calibration.solution import Estimate, Solution
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor

NAME = "left.auto_exposure_level"
_LEAST_SCENES = 2  # One says nothing of how far scenes scatter about what is aimed at.


def fit_exposure_level(observations: Sequence[Observation], sensor: Sensor) -> Solution | None:
    """Take the mean level of the left images, projector on, over scenes.

    A device meters by rules of its own; what it aims at comes out on average only. Scenes too
    dark for the longest exposure would lower it.

    Args:
        observations: with infrared images.
        sensor: to set the level in, of both imagers.

    Returns:
        The level over full scale and the deviation of its mean over scenes. None where the
        sensor's exposure is fixed, or fewer than two scenes were taken.
    """
    if sensor.left.auto_exposure_level == 0:
        return None
    levels = [float(one.left.mean()) for one in observations if one.left is not None]
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
