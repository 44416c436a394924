"""The projector's light: which irradiance it lays on the plane at unit distance."""

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
from starling.sim.sensor.emitter import Emitter
from starling.sim.sensor.sensor import Projector

# The lattices of a D415's two emitters, fitted to one unit in nine rooms (docs/figures.md): cycles
# over a unit of direction cosine, angle from x towards y; means over both directions of a lattice
# that is 0.4 degrees off square. The angles of another unit differ from these by -0.6 and 0.8
# degrees. Its dots' powers spread by less than 9 %, noise included: here they are alike.
_d415 = partial(patterns.lattice, units=1, power_spread=0.0)
GENERATORS: dict[str, Callable[..., patterns.Pattern]] = {
    "d415": patterns.lattice,  # Both lattices in one image, for one emitter.
    "d415-left": partial(_d415, rotation_deg=60.32, pitch_mrad=1e3 / 81.70),
    "d415-right": partial(_d415, rotation_deg=49.22, pitch_mrad=1e3 / 81.28, stream=1),
    "d435": patterns.quasirandom,
    "kinect": patterns.tiled,
    "uniform": patterns.uniform,
}
# Which arguments of generators go with `dot_density`, and with which power of it.
_DENSITY = {"pitch_mrad": -0.5, "dots_per_deg2": 1.0, "sites_x": 0.5, "sites_y": 0.5}
NEAREST_M = 0.1  # Nearer surfaces get no wider dots by defocus.
_STEP = 1.5  # Variance of one level of `Defocus` over the one before.


def half_tangents(projector: Projector) -> tuple[float, float]:
    """Tangents of half the field, horizontal and vertical."""
    return (
        float(np.tan(np.deg2rad(projector.fov_x_deg / 2))),
        float(np.tan(np.deg2rad(projector.fov_y_deg / 2))),
    )


def emitters(projector: Projector) -> tuple[Emitter, ...]:
    """The emitters of a projector, at least one; each has its pattern, shares sum to 1."""
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
    """Make a pattern by a generator's name or load it from an image file.

    Args:
        name: of a generator, or an image file.
        fov_x_deg: full horizontal field [deg].
        fov_y_deg: full vertical field [deg].
        seed: of the generator.
        density: dots in a solid angle over the generator's own. Spots keep their width.

    Raises:
        InputError: if the name is neither a generator's nor a readable image's, or another
            density is asked of an image.
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
    """Arguments that give a generator's pattern another density than its own."""
    if density == 1:
        return {}
    own = inspect.signature(GENERATORS[name]).parameters
    scaled = {
        key: own[key].default * density**power for key, power in _DENSITY.items() if key in own
    }
    return {
        key: round(value) if isinstance(own[key].default, int) else value
        for key, value in scaled.items()
    }


def irradiance_at_unit_distance(projector: Projector, number: int = 0) -> NDArray[np.float32]:
    """Irradiance [W m^-2] that 1 W lays on the plane 1 m in front, perpendicular to the axis.

    Args:
        projector: its `pattern_scale` is left to who looks the light up (see `starling.sim.render.beam`).
        number: of the emitter whose part of the light, axis and place are meant.

    Returns:
        (h, w) over the projector's field in tangent coordinates, OpenCV orientation, in focus.
        A share `haze` of the light is spread evenly in place of dots, and no fault befalls it.
        With `falloff` n the light at angle a from the axis is dimmed by cos^n a; what this takes
        away is lost, as behind a real lens. So is the light of dropped dots, and what wider or
        shifted dots throw out of the field.

    Raises:
        InputError: if the pattern cannot be had, or has not the dots that are dropped or shifted.
    """
    source = _faulty(projector, number)
    return _on_plane(projector, number, _relative(source, projector.dot_blur_mrad))


def as_stored(projector: Projector) -> Projector:
    """The projector as it was when a structured-light camera's reference was stored.

    What befell the dots later, and how the projector has turned since, is not in the reference:
    that is what makes such a camera err. Nor is what heat has made of the pattern's scale.

    Raises:
        InputError: if the projector has several emitters: seen from one place, the pattern of
            another looks different at every distance.
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
    """The pattern at growing widths of its dots.

    Level k holds spots of the variance `variance_mrad2` times 1.5^k, so that between two levels
    a linear mixture has the variance in between, its peak at most 4 % high.
    """

    levels: NDArray[np.float32]  # (n, h, w) [W m^-2] on the plane at unit distance, from 1 W
    variance_mrad2: float  # Of a spot in focus.
    ratio: float = _STEP


def defocused(projector: Projector, number: int = 0) -> Defocus:
    """The levels that an emitter needs for surfaces from 0.1 m to infinity.

    Args:
        projector, number: as `irradiance_at_unit_distance`.

    Raises:
        InputError: likewise.
    """
    source = _faulty(projector, number)
    made = pattern(*source[:5])
    # A drawn image has no narrower spots than its pixels hold.
    fwhm_mrad = made.fwhm_mrad or 1e3 * dots.NARROWEST_PX / max(made.field.focal_px(made.shape))
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
    """What tells one pattern with its dark and displaced dots from another."""
    return (
        emitters(projector)[number].pattern,
        projector.fov_x_deg,
        projector.fov_y_deg,
        projector.pattern_seed,
        projector.dot_density,
        projector.dropped_dots,
        projector.shifted_dots_mrad,
        projector.faults_seed if projector.faulty else 0,  # Intact, equal patterns are one.
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
        # The faults belong to the piece of glass, as the pattern does: not to a capture.
        rng=randomness.generator(seed, device, "light", drawn),
    )
    image.flags.writeable = False
    return image
