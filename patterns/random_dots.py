"""Random dots: independent, or with a minimum distance as in the D435."""

from __future__ import annotations

import math

import numpy as np

from starling.patterns.dots import check_count, check_width, relative_powers
from starling.patterns.errors import in_interval, seeded_generator
from starling.patterns.field import Field, unit_vectors
from starling.patterns.pattern import Pattern

WIDEST_DISTANCE = 0.78  # Random sequential packing of discs jams near 0.83.


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


def quasirandom(
    *,
    fov_x_deg: float = 90.0,
    fov_y_deg: float = 63.0,
    width_px: int = 1920,
    dots_per_deg2: float = 0.55,
    min_distance: float = 0.7,
    fwhm_mrad: float = 8.3,
    power_spread: float = 0.2,
    background: float = 0.3,
    seed: int = 0,
) -> Pattern:
    """Generate blue-noise dots, uniform over the solid angle with a minimum distance.

    The defaults imitate the D435. Sources disagree. Density: 0.55 per square degree measured in
    D435 images (the default, 2733 dots). The maker names about 5000 spots
    (dev.intelrealsense.com/docs/projectors): 1.0 per square degree over 90 x 63 deg, 1.15 over
    86 x 57. Field: 90 x 63 deg (D400 datasheet) or 86 x 57 (FRAMOS D435e manual, p. 8). The D455
    is assumed to have the D435's projector.

    Args:
        fov_x_deg: Full horizontal field [deg].
        fov_y_deg: Full vertical field [deg].
        width_px: Image width [px].
        dots_per_deg2: Dots per square degree of solid angle.
        min_distance: Least angle between two dots, in units of the mean spacing
            1 / sqrt(density), in [0, 0.78]. Assumed.
        fwhm_mrad: Spot width [mrad]. 5.6 px measured at a focal length of 640 px, less an
            assumed 1.7 px of imager blur.
        power_spread: Standard deviation / mean of dot powers. Assumed.
        background: Share of light not in dots. Assumed to be the D415's.
        seed: Fixes positions and powers.

    Raises:
        InputError: if a parameter is out of range.
    """
    field = Field(fov_x_deg, fov_y_deg)
    check_width(fwhm_mrad, field.shape(width_px), field)
    in_interval("min_distance", min_distance, 0.0, WIDEST_DISTANCE, "Lower it: no room is left.")
    n = dot_count(field, dots_per_deg2)
    rng = seeded_generator(seed)
    x, y = _spaced(n, min_distance * math.radians(dots_per_deg2**-0.5), field, rng)
    return Pattern.from_dots(
        x,
        y,
        relative_powers(n, power_spread, rng),
        field=field,
        width_px=width_px,
        fwhm_mrad=fwhm_mrad,
        background=background,
        name=f"quasi-random, {n} dots, seed {seed}",
    )


def _spaced(
    n: int, angle: float, field: Field, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw `n` directions at least `angle` [rad] apart, by dart throwing in batches."""
    from scipy.spatial import KDTree  # Heavy, like all of scipy: not at import.

    chord = 2 * math.sin(angle / 2)
    x, y = np.empty(0), np.empty(0)
    while len(x) < n:
        new_x, new_y = field.uniform_directions(2 * n, rng)
        points = unit_vectors(new_x, new_y)
        if len(x):
            gap, _ = KDTree(unit_vectors(x, y)).query(points, distance_upper_bound=chord)
            free = ~np.isfinite(gap)
            new_x, new_y, points = new_x[free], new_y[free], points[free]
        keep = _spaced_subset(points, chord)
        x, y = np.concatenate([x, new_x[keep]]), np.concatenate([y, new_y[keep]])
    return x[:n], y[:n]


def _spaced_subset(points: np.ndarray, chord: float) -> np.ndarray:
    """Mask of points (m, 3) left after each kept point removes later ones within `chord`."""
    from scipy.spatial import KDTree

    keep = np.ones(len(points), dtype=bool)
    if not len(points):
        return keep
    pairs = KDTree(points).query_pairs(chord, output_type="ndarray")
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    for first, second in pairs[order].tolist():  # first < second, firsts ascending.
        if keep[first]:
            keep[second] = False
    return keep
