"""Model of a projector's emitters: light on surfaces, and derivatives by all parameters.

When an emitter moves, dots shift in each view. A re-solved pattern image follows the mean shift
over the views in each direction. Only the difference between views at different distances
determines the emitter's position. A step without this correction would move the image instead.

Source of the correction: the projector of variable projection (Golub and Pereyra, SIAM J. Numer.
Anal. 10(2), 1973), for an image with many pixels in each direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starling.calibration.pattern import cosine_image, emission
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import RightAlignment, SurfacePoints
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.pattern.views import Array

_LATTICE = (
    *(f"frequency.{i}{j}" for i in range(2) for j in range(2)),
    *(f"phase.{i}" for i in range(2)),
    *(f"keystone.{i}" for i in range(2)),
    "sigma",
)
_MOST_WIDER = 1.2  # Maximum factor of a dot's width per step.
_CELL = 8  # Cell size in pixels of the pattern image; shifts vary slowly with direction.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AbsorbedMotion:
    """Mean derivative of the cosines over all views, by direction."""

    grid: Grid
    partials: Mapping[str, tuple[Array, Array]]  # By parameter: derivatives of a and b, (h, w).

    def interpolate(self, name: str, cosines: Array) -> Array:
        """Return the mean derivative (n, 2) in the directions `cosines` (n, 2)."""
        place, values = self.grid.place(cosines), np.zeros((2, len(cosines)), np.float32)
        for image, row in zip(self.partials[name], values, strict=True):
            cosine_image.read(image, place, row)
        return values.T


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PatternEmitter:
    """One emitter: its position and its pattern over directions."""

    position_m: NDArray[np.float64]  # (3,) in the left frame.
    source: Lattice | PatternImage
    # Motion that a re-solved image absorbs; None if the image is fixed.
    absorbed: AbsorbedMotion | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EmitterModel:
    """All parameters of a fit of emitters."""

    emitters: tuple[PatternEmitter, ...]
    rotation_deg: tuple[
        float, float, float
    ]  # Rotation of the projector; dots scale about its axis.
    scales: Mapping[str, float]  # Pattern scale of each scene; their mean is 1.
    alignment: RightAlignment = field(default_factory=RightAlignment)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in order.

        A lattice is regular about the projector's axes and determines their rotation. A pattern
        image rotates with the axes and does not.
        """
        turns = any(isinstance(emitter.source, Lattice) for emitter in self.emitters)
        return (
            *(
                f"{emitter_prefix(k)}{name}"
                for k, emitter in enumerate(self.emitters)
                for name in emitter_names(emitter)
            ),
            *(emission.TURN if turns else ()),
            *(scene_scale_name(scene) for scene in self.scales),
            *(f"right.{name}" for name in emission.RIGHT),
        )


def emitter_prefix(number: int) -> str:
    """Return the prefix of one emitter's parameter names."""
    return f"emitter{number}."


def scene_scale_name(scene: str) -> str:
    """Return the name of a scene's pattern scale."""
    return f"pattern_scale[{scene}]"


def scene_from_name(name: str) -> str:
    """Return the scene of a pattern scale's name; empty for any other name."""
    inner = name.removeprefix("pattern_scale[").removesuffix("]")
    return inner if scene_scale_name(inner) == name else ""


def emitter_names(emitter: PatternEmitter) -> tuple[str, ...]:
    """Return the names of one emitter's parameters, without prefix."""
    place = tuple(f"position.{axis}" for axis in emission.PLACE)
    return place + _LATTICE if isinstance(emitter.source, Lattice) else place


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EmitterLight:
    """Light of one emitter on surface points."""

    rays: emission.Directions
    light: Array  # (n,) relative to a dot's peak, or to the image's deviation; 0 if unknown.
    slope: Array  # (n, 2) derivative of the light by the nominal cosines.
    even_slope: Array  # (n, 2) derivative by the cosines without keystone.
    offset: Array | None  # (n, 2) cosines from the nearest dot of a lattice.


def illuminate(surface: SurfacePoints, model: EmitterModel, scale: float) -> list[EmitterLight]:
    """Compute the light of each emitter on the surface points."""
    points = surface.shifted(model.alignment)
    return [_illuminate(points, emitter, model.rotation_deg, scale) for emitter in model.emitters]


def _illuminate(
    points_m: Array, emitter: PatternEmitter, rotation_deg: tuple[float, float, float], scale: float
) -> EmitterLight:
    rays = emission.directions(
        points_m, position_m=emitter.position_m, rotation_deg=rotation_deg, scale=scale
    )
    known = np.isfinite(rays.range_m)
    cosines = _known_cosines(rays)
    if isinstance(emitter.source, Lattice):
        offset = emitter.source.nearest(cosines)[1].astype(np.float32)
        variance = np.float32(emitter.source.sigma**2)
        light = np.exp(-(offset**2).sum(axis=1) / (2 * variance)) * known
        even_slope = -offset / variance * light[:, None]
        widening = emitter.source.keystone.astype(np.float32)
        slope = (1 - cosines @ widening)[:, None] * even_slope
        slope -= (even_slope * cosines).sum(axis=1)[:, None] * widening
        return EmitterLight(
            rays=rays,
            light=light.astype(np.float32),
            slope=slope,
            even_slope=even_slope,
            offset=offset,
        )
    grid = emitter.source.grid
    place = grid.place(cosines)
    light, slope = np.zeros(len(place), np.float32), np.empty_like(place)
    cosine_image.read(emitter.source.value, place, light)
    cosine_image.slope(emitter.source.value, place, slope)
    slope /= np.float32(grid.step)
    return EmitterLight(rays=rays, light=light, slope=slope, even_slope=slope, offset=None)


def derivatives(
    surface: SurfacePoints,
    scene: str,
    emitter: PatternEmitter,
    light: EmitterLight,
    number: int,
    turns: bool,
) -> dict[str, Array]:
    """Return derivatives of one emitter's light (n,), by parameter name."""

    def along(partial: Array) -> Array:
        return light.slope[:, 0] * partial[:, 0] + light.slope[:, 1] * partial[:, 1]

    by_name = partials(surface, scene, light.rays, number)
    if turns:
        by_name |= dict(zip(emission.TURN, emission.turn_partials(light.rays), strict=True))
    columns = {name: along(partial) for name, partial in by_name.items()}
    if isinstance(emitter.source, Lattice):
        names = (emitter_prefix(number) + name for name in _LATTICE)
        columns |= dict(zip(names, _lattice_columns(emitter.source, light), strict=True))
    if emitter.absorbed is not None:
        for name in emitter.absorbed.partials:
            absorbed_change = along(emitter.absorbed.interpolate(name, _known_cosines(light.rays)))
            columns[name] = columns.get(name, np.float32(0)) - absorbed_change
    return columns


def partials(
    surface: SurfacePoints, scene: str, rays: emission.Directions, number: int
) -> dict[str, Array]:
    """Return derivatives (n, 2) of one emitter's cosines by the parameters that move dots."""
    places = (f"{emitter_prefix(number)}position.{axis}" for axis in emission.PLACE)
    by_name = dict(zip(places, emission.place_partials(rays), strict=True))
    by_name[scene_scale_name(scene)] = emission.scale_partial(rays)
    if surface.side == "right":
        names = (f"right.{name}" for name in emission.RIGHT)
        by_name |= dict(zip(names, emission.right_partials(surface, rays), strict=True))
    return by_name


def average_motion(
    views: Iterable[tuple[Array, Array, Mapping[str, Array]]], grid: Grid
) -> AbsorbedMotion:
    """Average derivatives over views.

    Args:
        views: for each view, cosines (n, 2), weights (n,), and derivatives (n, 2) of the cosines
            by parameter. Missing derivatives count as 0.
        grid: grid of the pattern image.
    """
    coarse = Grid(half_a=grid.half_a, half_b=grid.half_b, step=_CELL * grid.step)
    total = np.zeros(coarse.shape, np.float32)
    sums: dict[str, tuple[Array, Array]] = {}
    for cosines, weight, partials in views:
        place = coarse.place(cosines)
        cosine_image.add(total, place, weight)
        for name, partial in partials.items():
            zeros = np.zeros_like(total), np.zeros_like(total)
            for axis, image in enumerate(sums.setdefault(name, zeros)):
                cosine_image.add(image, place, weight * np.nan_to_num(partial[:, axis]))
    share = 1 / np.maximum(total, np.float32(1e-6))
    return AbsorbedMotion(
        grid=coarse, partials={name: (a * share, b * share) for name, (a, b) in sums.items()}
    )


def _known_cosines(rays: emission.Directions) -> Array:
    """Return cosines (n, 2); unknown directions lie outside any field."""
    return np.where(np.isfinite(rays.range_m)[:, None], rays.cosines, np.float32(9))


def _lattice_columns(lattice: Lattice, light: EmitterLight) -> list[Array]:
    """Return derivatives by frequencies, phase, keystone and width, from s = F a - phase."""
    assert light.offset is not None
    step_slopes = light.even_slope @ lattice.pitch.astype(np.float32)
    cosines = light.rays.cosines
    even = cosines * (1 - cosines @ lattice.keystone.astype(np.float32))[:, None]
    radial = (light.even_slope * cosines).sum(axis=1)
    squared = (light.offset**2).sum(axis=1) / np.float32(lattice.sigma**3)
    return [
        *(step_slopes[:, i] * even[:, j] for i in range(2) for j in range(2)),
        *(-step_slopes[:, i] for i in range(2)),
        *(-radial * cosines[:, i] for i in range(2)),
        light.light * squared,
    ]


def apply_step(model: EmitterModel, step: NDArray[np.float64]) -> EmitterModel:
    """Apply to a model a step (n,) of `Model.names`."""
    by_name = dict(zip(model.names, map(float, step), strict=True))
    emitters = tuple(
        _apply_emitter_step(
            emitter,
            np.array([by_name[emitter_prefix(k) + name] for name in emitter_names(emitter)]),
        )
        for k, emitter in enumerate(model.emitters)
    )
    axes = Rotation.from_rotvec(model.rotation_deg, degrees=True)
    rotation = [by_name.get(name, 0.0) for name in emission.TURN]
    x, y, z = (axes * Rotation.from_rotvec([*rotation, 0.0])).as_rotvec(degrees=True)
    right = np.array([by_name[f"right.{name}"] for name in emission.RIGHT])
    return replace(
        model,
        emitters=emitters,
        rotation_deg=(float(x), float(y), float(z)),
        scales={
            scene: old + by_name[scene_scale_name(scene)] for scene, old in model.scales.items()
        },
        alignment=RightAlignment.from_vector(model.alignment.as_vector() + right),
    )


def _apply_emitter_step(emitter: PatternEmitter, step: NDArray[np.float64]) -> PatternEmitter:
    position, source = emitter.position_m + step[:3], emitter.source
    if isinstance(source, Lattice):
        sigma = np.clip(
            source.sigma + step[11], source.sigma / _MOST_WIDER, source.sigma * _MOST_WIDER
        )
        source = Lattice(
            frequencies=source.frequencies + step[3:7].reshape(2, 2),
            phase=source.phase + step[7:9],
            keystone=source.keystone + step[9:11],
            sigma=float(sigma),
        )
    return replace(emitter, position_m=position, source=source)
