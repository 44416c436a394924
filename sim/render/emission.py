"""The projector's irradiance on the plane at unit distance."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling import patterns
from starling.patterns import dots, errors, faults
from starling.sim import randomness
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Projector

# Lattices of a D415's two emitters, fitted to one unit in nine rooms
# (docs/results/calibration.md). Cycles per unit of direction cosine, and angle from x towards y.
# Each lattice is 0.4 degrees off square; the numbers are means over its directions. The angles of
# another unit differ by -0.6 and 0.8 degrees. The dots' powers spread by less than 9 % including
# noise, so they are taken as equal.
_d415 = partial(patterns.lattice, units=1, power_spread=0.0)
GENERATORS: dict[str, Callable[..., patterns.Pattern]] = {
    "d415": patterns.lattice,  # Both lattices in one image, for a single emitter.
    "d415-left": partial(_d415, rotation_deg=60.32, pitch_mrad=1e3 / 81.70),
    "d415-right": partial(_d415, rotation_deg=49.22, pitch_mrad=1e3 / 81.28, stream=1),
    "d435": patterns.quasirandom,
    "kinect": patterns.tiled,
    "uniform": patterns.uniform,
}
# Generator arguments that depend on `dot_density`, and the exponent of the dependence.
_DENSITY = {"pitch_mrad": -0.5, "dots_per_deg2": 1.0, "sites_x": 0.5, "sites_y": 0.5}
NEAREST_M = 0.1  # Defocus on closer surfaces is that at this distance [m].
_STEP = 1.5  # Ratio of the variances of consecutive levels of `Defocus`.


def half_tangents(projector: Projector) -> tuple[float, float]:
    """Tangents of half the field, horizontal and vertical."""
    return (
        float(np.tan(np.deg2rad(projector.fov_x_deg / 2))),
        float(np.tan(np.deg2rad(projector.fov_y_deg / 2))),
    )


def emitters(projector: Projector) -> tuple[Emitter, ...]:
    """The emitters of a projector, at least one, with their patterns and shares of sum 1."""
    several = projector.emitters or (Emitter(),)
    total = sum(emitter.power_share for emitter in several)
    return tuple(
        dataclasses.replace(
            emitter,
            pattern=emitter.pattern or projector.pattern,
            power_share=emitter.power_share / total,
        )
        for emitter in several
    )


@lru_cache(maxsize=8)
def pattern(
    name: str, fov_x_deg: float, fov_y_deg: float, seed: int, density: float = 1.0
) -> patterns.Pattern:
    """Generate a pattern by a generator's name, or load it from an image file.

    Args:
        name: Name of a generator, or image file.
        fov_x_deg: Full horizontal field [deg].
        fov_y_deg: Full vertical field [deg].
        seed: Seed of the generator.
        density: Dots per solid angle over the generator's default. Spots keep their width.

    Raises:
        InputError: if the name is neither a generator nor a readable image, or if `density` is not
            1 for an image.
    """
    if name in GENERATORS:
        make = GENERATORS[name]
        return make(fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg, seed=seed, **_denser(name, density))
    if not Path(name).suffix:
        errors.one_of("projector.pattern", name, GENERATORS)
    if density != 1:
        raise errors.refuse(
            "projector.dot_density",
            "must be 1 for a pattern from an image file, which has the dots it has",
            density,
            f"Choose one of {', '.join(GENERATORS)}, or draw another image.",
        )
    return patterns.load(name, fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg)


def _denser(name: str, density: float) -> dict[str, float]:
    """Generator arguments for a density relative to the default."""
    if density == 1:
        return {}
    parameters = inspect.signature(GENERATORS[name]).parameters
    scaled = {
        key: parameters[key].default * density**power
        for key, power in _DENSITY.items()
        if key in parameters
    }
    return {
        key: round(value) if isinstance(parameters[key].default, int) else value
        for key, value in scaled.items()
    }


def irradiance_at_unit_distance(projector: Projector, number: int = 0) -> NDArray[np.float32]:
    """Irradiance [W m^-2] of 1 W on the plane at 1 m, perpendicular to the axis.

    Args:
        projector: Projector. `starling.sim.render.beam` applies its `pattern_scale`.
        number: Number of the emitter.

    Returns:
        (h, w) over the projector's field in tangent coordinates, OpenCV orientation, in focus. A
        share `haze` of the light is spread evenly and has no faults. With `falloff` n, light at
        angle a off the axis is dimmed by cos^n a. The light removed by falloff, dropped dots and
        dots outside the field is lost.

    Raises:
        InputError: if the pattern is not available, or has no dot list for its faults.
    """
    source = _faulty(projector, number)
    return _on_plane(projector, number, _relative(source, projector.dot_blur_mrad))


def reference_projector(projector: Projector) -> Projector:
    """The projector at the time a structured-light camera's reference was stored.

    The reference excludes later faults, rotation and changes of the pattern's scale. They cause
    the errors of such a camera.

    Raises:
        InputError: if the projector has several emitters, whose combined pattern depends on the
            distance.
    """
    if projector.emitters:
        raise errors.refuse(
            "projector.emitters",
            "must be [] with structured light, whose reference is seen from one place",
            f"{len(projector.emitters)} emitters",
            "Set it so, or take a stereo camera.",
        )
    return dataclasses.replace(
        projector,
        rotation_deg=(0.0, 0.0, 0.0),
        pattern_scale=1.0,
        dropped_dots=0.0,
        shifted_dots_mrad=0.0,
        dot_blur_mrad=0.0,
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Defocus:
    """The pattern at increasing dot widths.

    Level k has spots of variance `variance_mrad2` times 1.5^k. A linear mixture of two levels has
    the variance in between, with a peak at most 4 % too high.
    """

    levels: NDArray[np.float32]  # (n, h, w) [W m^-2] on the plane at unit distance, from 1 W
    variance_mrad2: float  # Variance of a spot in focus.
    ratio: float = _STEP


def defocus_levels(projector: Projector, number: int = 0) -> Defocus:
    """Compute an emitter's levels for surfaces from 0.1 m to infinity.

    Arguments and errors are those of `irradiance_at_unit_distance`.
    """
    source = _faulty(projector, number)
    base = pattern(*source[:5])
    # The spots of an image are at least as wide as its pixels allow.
    fwhm_mrad = base.fwhm_mrad or 1e3 * dots.NARROWEST_PX / max(base.field.focal_px(base.shape))
    variance = (dots.SIGMA_PER_FWHM * fwhm_mrad) ** 2 + projector.dot_blur_mrad**2
    focus = 1 / projector.focus_m
    widest = projector.defocus_mrad_m * max(focus, 1 / NEAREST_M - focus)
    count = 2 + int(np.log1p(widest**2 / variance) / np.log(_STEP))
    blurs = np.sqrt(projector.dot_blur_mrad**2 + variance * (_STEP ** np.arange(count) - 1))
    levels = [_on_plane(projector, number, _relative(source, float(blur))) for blur in blurs]
    return Defocus(levels=np.stack(levels), variance_mrad2=variance)


def _on_plane(
    projector: Projector, number: int, relative: NDArray[np.float32]
) -> NDArray[np.float32]:
    half_x, half_y = half_tangents(projector)
    scale = np.float32(emitters(projector)[number].power_share / (4 * half_x * half_y))
    if projector.haze:
        relative = np.float32(1 - projector.haze) * relative + np.float32(projector.haze)
    if projector.falloff == 0:
        return relative * scale
    height, width = relative.shape
    x = (2 * (np.arange(width) + 0.5) / width - 1) * half_x
    y = (2 * (np.arange(height) + 0.5) / height - 1) * half_y
    cosine = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    return relative * (scale * cosine**projector.falloff).astype(np.float32)


_Source = tuple[str, float, float, int, float, float, float, int, int]


def _faulty(projector: Projector, number: int) -> _Source:
    """Cache key of a pattern with its faults."""
    return (
        emitters(projector)[number].pattern,
        projector.fov_x_deg,
        projector.fov_y_deg,
        projector.pattern_seed,
        projector.dot_density,
        projector.dropped_dots,
        projector.shifted_dots_mrad,
        projector.faults_seed if projector.faulty else 0,  # Intact equal patterns share a key.
        number if projector.faulty else 0,
    )


@lru_cache(maxsize=24)
def _relative(source: _Source, blur_mrad: float) -> NDArray[np.float32]:
    """Relative irradiance (h, w), read-only; the intact pattern's mean is 1."""
    name, fov_x_deg, fov_y_deg, seed, density, dropped, shifted_mrad, device, number = source
    drawn = f"faults of the pattern, emitter {number}" if number else "faults of the pattern"
    image = faults.irradiance(
        pattern(name, fov_x_deg, fov_y_deg, seed, density),
        dropped=dropped,
        shifted_mrad=shifted_mrad,
        widened_mrad=blur_mrad,
        # Faults belong to the device's optical element, not to a capture.
        rng=randomness.generator(seed, device, "light", drawn),
    )
    image.flags.writeable = False
    return image
