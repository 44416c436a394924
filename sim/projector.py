"""The projector's light: which irradiance it lays on the plane at unit distance."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import patterns
from sim.sensor import Projector


def irradiance_at_unit_distance(projector: Projector) -> NDArray[np.float32]:
    """Irradiance [W m^-2] on the plane 1 m in front, perpendicular to the axis.

    Returns:
        (h, w) in tangent coordinates over the projector's field, OpenCV orientation. With
        `falloff` n every direction at angle a from the axis is dimmed by cos^n a; the power that
        this takes away is lost, as in a real emitter.
    """
    half_x, half_y = half_tangents(projector)
    return _shape(projector.pattern, projector.pattern_seed, projector.fov_x_deg,
                  projector.fov_y_deg, projector.falloff) * np.float32(
        projector.power_w / (4 * half_x * half_y)
    )


def half_tangents(projector: Projector) -> tuple[float, float]:
    """Tangents of half the field, horizontal and vertical."""
    return (
        float(np.tan(np.deg2rad(projector.fov_x_deg / 2))),
        float(np.tan(np.deg2rad(projector.fov_y_deg / 2))),
    )
