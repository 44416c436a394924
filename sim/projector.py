"""The projector's light: which irradiance it lays on the plane at unit distance."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import patterns
from patterns import errors
from sim.sensor import Projector

GENERATORS = {
    "d415": patterns.lattice,
    "d435": patterns.quasirandom,
    "kinect": patterns.tiled,
    "uniform": patterns.uniform,
}


def half_tangents(projector: Projector) -> tuple[float, float]:
    """Tangents of half the field, horizontal and vertical."""
    return (
        float(np.tan(np.deg2rad(projector.fov_x_deg / 2))),
        float(np.tan(np.deg2rad(projector.fov_y_deg / 2))),
    )


@lru_cache(maxsize=8)
def pattern(name: str, fov_x_deg: float, fov_y_deg: float, seed: int) -> patterns.Pattern:
    """Make a pattern by a generator's name or load it from an image file.

    Raises:
        InputError: if the name is neither a generator's nor a readable image's.
    """
    if name in GENERATORS:
        return GENERATORS[name](fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg, seed=seed)
    if not Path(name).suffix:
        errors.one_of("projector.pattern", name, GENERATORS)
    return patterns.load(name, fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg)


def irradiance_at_unit_distance(projector: Projector) -> NDArray[np.float32]:
    """Irradiance [W m^-2] that 1 W lays on the plane 1 m in front, perpendicular to the axis.

    Returns:
        (h, w) over the projector's field in tangent coordinates, OpenCV orientation. With
        `falloff` n the light at angle a from the axis is dimmed by cos^n a; what this takes away
        is lost, as behind a real lens.
    """
    half_x, half_y = half_tangents(projector)
    relative = pattern(
        projector.pattern, projector.fov_x_deg, projector.fov_y_deg, projector.pattern_seed
    ).image
    scale = np.float32(1 / (4 * half_x * half_y))
    if projector.falloff == 0:
        return relative * scale
    height, width = relative.shape
    x = (2 * (np.arange(width) + 0.5) / width - 1) * half_x
    y = (2 * (np.arange(height) + 0.5) / height - 1) * half_y
    cosine = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    return relative * (scale * cosine**projector.falloff).astype(np.float32)
