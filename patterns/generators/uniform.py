"""Uniform random dots: the simplest pattern, a reference for the other generators."""

from __future__ import annotations

import numpy as np

from starling.patterns.dots import check_count, check_width, relative_powers
from starling.patterns.errors import in_interval, seeded_generator
from starling.patterns.field import Field
from starling.patterns.pattern import Pattern


def uniform(
    *,
    fov_x_deg: float = 90.0,
    fov_y_deg: float = 63.0,
    width_px: int = 1920,
    dots_per_deg2: float = 0.55,
    fwhm_mrad: float = 8.3,
    power_spread: float = 0.2,
    background: float = 0.3,
    seed: int = 0,
) -> Pattern:
    """Generate dots at independent directions, uniform over the solid angle.

    Dots may overlap: with the defaults about a sixth of the emitted dots merge with others. The
    defaults equal the quasi-random pattern's, for comparison. No device is imitated.

    Args:
        fov_x_deg: Full horizontal field [deg].
        fov_y_deg: Full vertical field [deg].
        width_px: Image width [px].
        dots_per_deg2: Dots emitted per square degree of solid angle.
        fwhm_mrad: Spot width [mrad].
        power_spread: Standard deviation / mean of dot powers.
        background: Share of light not in dots.
        seed: Fixes positions and powers.

    Raises:
        InputError: if a parameter is out of range.
    """
    field = Field(fov_x_deg, fov_y_deg)
    check_width(fwhm_mrad, field.shape(width_px), field)
    n = dot_count(field, dots_per_deg2)
    rng = seeded_generator(seed)
    x, y = field.uniform_directions(n, rng)
    return Pattern.from_dots(
        x,
        y,
        relative_powers(n, power_spread, rng),
        field=field,
        width_px=width_px,
        fwhm_mrad=fwhm_mrad,
        background=background,
        name=f"uniform, {n} dots, seed {seed}",
    )


def dot_count(field: Field, dots_per_deg2: float) -> int:
    """Number of dots in the field for a density per square degree of solid angle.

    Raises:
        InputError: if the density is out of range, or gives 0 or more than 200 000 dots.
    """
    in_interval("dots_per_deg2", dots_per_deg2, 1e-4, 1e4, "Give dots per square degree.")
    n = int(np.rint(dots_per_deg2 * field.solid_angle_deg2))
    check_count(n, "Change dots_per_deg2 or the field.")
    return n
