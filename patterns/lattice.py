"""Lattice patterns: emitter clusters repeated over rotated grids, as in the D415."""

from __future__ import annotations

import math

import numpy as np

from starling.patterns.dots import check_count, check_width, relative_powers
from starling.patterns.errors import in_interval, seeded_generator, whole_number
from starling.patterns.field import Field, directions_from_cosines
from starling.patterns.pattern import Pattern


def lattice(
    *,
    fov_x_deg: float = 67.0,
    fov_y_deg: float = 41.0,
    width_px: int = 1920,
    units: int = 2,
    rotation_deg: float = 49.0,
    twist_deg: float = 11.0,
    pitch_mrad: float = 12.3,
    emitters: int = 1,
    cluster_mrad: float = 6.0,
    jitter_mrad: float = 0.0,
    fwhm_mrad: float = 3.4,
    power_spread: float = 0.2,
    background: float = 0.3,
    seed: int = 0,
    stream: int = 0,
) -> Pattern:
    """Generate a cluster of emitters repeated over a square grid, once per projector unit.

    The grid is even in direction cosines, as a diffractive element makes it. Two units rotated
    against each other form a moire of rosettes, `pitch / (2 sin(twist / 2))` apart, with
    coinciding dots in their centres. A D415 shows this; its maker names two Heptagon units. Real
    units sit some millimetres apart, so their moire drifts with depth. One image cannot show the
    drift: project `units=1` patterns of two streams from two positions instead.

    The defaults with seed 0 give 9547 dots, 3.7 per square degree (4.0 on the axis). At their own
    width 3.3 per square degree are separate, behind an imager's blur about 2.9.

    Args:
        fov_x_deg: Full horizontal field [deg]. Source: D400 datasheet, D415 projector 67 x 41.
        fov_y_deg: Full vertical field [deg].
        width_px: Image width [px].
        units: Projector units, 1 to 4. Source of 2: dev.intelrealsense.com/docs/projectors.
        rotation_deg: Angle of the first unit's grid, from x towards y. Measured on one D415.
        twist_deg: Angle from each unit to the next. Measured on one D415.
        pitch_mrad: Grid pitch in direction cosine x 1000. Measured on one D415.
        emitters: Emitters in a cluster, 1 to 64; the lattice of a D415 needs one.
        cluster_mrad: Side of the square that holds the cluster's emitters [mrad].
        jitter_mrad: Standard deviation of each dot's random displacement [mrad].
        fwhm_mrad: Spot width [mrad]. Measured 3.8 in the images, less an assumed 1.7 px of
            imager blur at a focal length of 896 px.
        power_spread: Standard deviation / mean of the dots' powers. Assumed.
        background: Share of light not in dots. Measured with the projector on and off on one
            D415 scene (fifth percentile over mean 0.31), the scene's indirect light included.
        seed: Fixes cluster, grid offsets, jitter and powers.
        stream: Number of the seed's independent random stream, 0 to 15. Two lattices of one stream
            would share their offset and always coincide on the axis.

    Raises:
        InputError: if a parameter is out of range.
    """
    field = Field(fov_x_deg, fov_y_deg)
    check_width(fwhm_mrad, field.shape(width_px), field)
    units = whole_number("units", units, 1, 4, "Give the number of projector units.")
    emitters = whole_number(
        "emitters", emitters, 1, 64, "Give the number of emitters in a cluster."
    )
    stream = whole_number("stream", stream, 0, 15, "Give the number of one of a seed's draws.")
    in_interval("pitch_mrad", pitch_mrad, 2.0, 200.0, "Give the grid pitch in mrad.")
    in_interval("cluster_mrad", cluster_mrad, 0.0, 200.0, "Give the cluster's side in mrad.")
    in_interval("jitter_mrad", jitter_mrad, 0.0, 50.0, "Give a standard deviation in mrad.")
    in_interval("rotation_deg", rotation_deg, -360.0, 360.0)
    in_interval("twist_deg", twist_deg, -90.0, 90.0)
    # Upper bound: off the axis, a step in direction cosine spans a larger angle.
    cells = math.ceil(math.radians(1) ** 2 * field.solid_angle_deg2 / (pitch_mrad * 1e-3) ** 2)
    check_count(cells * units * emitters, "Raise pitch_mrad, or lower units or emitters.")
    rng = seeded_generator(seed).spawn(stream)[-1] if stream else seeded_generator(seed)
    x, y = [], []
    for unit in range(units):
        angle = math.radians(rotation_deg + unit * twist_deg)
        a, b = _grid(field, pitch_mrad * 1e-3, angle, rng)
        cluster = _cluster(emitters, cluster_mrad * 1e-3, rng)
        a = (a[:, None] + cluster[None, :, 0]).ravel()
        b = (b[:, None] + cluster[None, :, 1]).ravel()
        jitter = rng.standard_normal((2, len(a))) * (jitter_mrad * 1e-3)
        unit_x, unit_y = directions_from_cosines(a + jitter[0], b + jitter[1])
        x.append(unit_x)
        y.append(unit_y)
    x, y = np.concatenate(x), np.concatenate(y)
    inside = field.holds(x, y)
    x, y = x[inside], y[inside]
    return Pattern.from_dots(
        x,
        y,
        relative_powers(len(x), power_spread, rng),
        field=field,
        width_px=width_px,
        fwhm_mrad=fwhm_mrad,
        background=background,
        name=f"lattice, {units} units, {emitters} emitters, seed {seed}",
    )


def _grid(
    field: Field, pitch: float, angle: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Direction cosines (a, b) of a square grid that covers the field, at a random offset."""
    corner = math.hypot(field.half_x, field.half_y)
    reach = math.ceil(corner / math.hypot(1.0, corner) / pitch) + 2
    steps = np.arange(-reach, reach + 1)
    offset = rng.random(2)
    i, j = np.meshgrid(steps + offset[0], steps + offset[1], indexing="ij")
    cos, sin = math.cos(angle), math.sin(angle)
    return (pitch * (cos * i - sin * j)).ravel(), (pitch * (sin * i + cos * j)).ravel()


def _cluster(emitters: int, side: float, rng: np.random.Generator) -> np.ndarray:
    """Draw emitter offsets (emitters, 2) of mean zero by best-candidate sampling."""
    points = np.empty((0, 2))
    for _ in range(emitters):
        candidates = (rng.random((32, 2)) - 0.5) * side
        if len(points):
            gaps = np.linalg.norm(candidates[:, None] - points[None], axis=2).min(axis=1)
            candidates = candidates[np.argsort(-gaps, kind="stable")]
        points = np.concatenate([points, candidates[:1]])
    return points - points.mean(axis=0)
