"""Emitters, what they lay on surfaces, and how that moves with everything a fit frees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starling.calibration.pattern import cosine_image, emission
from starling.calibration.pattern.absorbed import Absorbed
from starling.calibration.pattern.emission import Alignment, Seen
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.pattern.views import Array

_LATTICE = (
    *(f"frequency.{i}{j}" for i in range(2) for j in range(2)),
    *(f"phase.{i}" for i in range(2)),
    *(f"keystone.{i}" for i in range(2)),
    "sigma",
)
_MOST_WIDER = 1.2  # A dot's width changes by at most this factor a step.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Emission:
    """One emitter: where it stands, and the pattern about its directions."""

    position_m: NDArray[np.float64]  # (3,) in the left frame.
    source: Lattice | PatternImage
    absorbed: Absorbed | None = None  # Of an image that follows the emitter; None: it is held.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model:
    """All that a fit of emitters frees."""

    emitters: tuple[Emission, ...]
    rotation_deg: tuple[float, float, float]  # Of the projector's axes, about which dots scale.
    scales: Mapping[str, float]  # Pattern scale of each scene; their mean is 1.
    alignment: Alignment = field(default_factory=Alignment)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what a fit frees, in its order.

        A lattice is even about the axes that it scales about, so it tells how they are turned; an
        image of a pattern turns with them, and nothing would change.
        """
        turns = any(isinstance(one.source, Lattice) for one in self.emitters)
        return (
            *(f"{of_emitter(k)}{name}" for k, one in enumerate(self.emitters) for name in own(one)),
            *(emission.TURN if turns else ()),
            *(of_scene(scene) for scene in self.scales),
            *(f"right.{name}" for name in emission.RIGHT),
        )


def of_emitter(number: int) -> str:
    """How the names of one emitter's parameters begin."""
    return f"emitter{number}."


def of_scene(scene: str) -> str:
    """Name of a scene's own pattern scale."""
    return f"pattern_scale[{scene}]"


def scene_of(name: str) -> str:
    """The scene whose pattern scale a name means; empty for any other name."""
    inner = name.removeprefix("pattern_scale[").removesuffix("]")
    return inner if of_scene(inner) == name else ""


def own(emitter: Emission) -> tuple[str, ...]:
    """Names of what one emitter frees."""
    place = tuple(f"position.{axis}" for axis in emission.PLACE)
    return place + _LATTICE if isinstance(emitter.source, Lattice) else place


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Laid:
    """What one emitter lays on surface points."""

    there: emission.Directions
    light: Array  # (n,) of a dot's peak, or of the pattern's deviation; 0 where nothing is known.
    slope: Array  # (n, 2) of the light by the nominal cosines.
    even: Array  # (n, 2) of the light by the cosines before any keystone.
    away: Array | None  # (n, 2) cosines from the nearest dot, of a lattice.


def lay(seen: Seen, model: Model, scale: float) -> list[Laid]:
    """Lay every emitter's light on the points that pixels show."""
    points = seen.moved(model.alignment)
    return [_laid(points, emitter, model.rotation_deg, scale) for emitter in model.emitters]


def _laid(
    points_m: Array, emitter: Emission, rotation_deg: tuple[float, float, float], scale: float
) -> Laid:
    there = emission.directions(
        points_m, position_m=emitter.position_m, rotation_deg=rotation_deg, scale=scale
    )
    known = np.isfinite(there.range_m)
    cosines = _known(there)
    if isinstance(emitter.source, Lattice):
        away = emitter.source.nearest(cosines)[1].astype(np.float32)
        variance = np.float32(emitter.source.sigma**2)
        light = np.exp(-(away**2).sum(axis=1) / (2 * variance)) * known
        even = -away / variance * light[:, None]
        widening = emitter.source.keystone.astype(np.float32)
        slope = (1 - cosines @ widening)[:, None] * even
        slope -= (even * cosines).sum(axis=1)[:, None] * widening
        return Laid(there=there, light=light.astype(np.float32), slope=slope, even=even, away=away)
    grid = emitter.source.grid
    place = grid.place(cosines)
    light, slope = np.zeros(len(place), np.float32), np.empty_like(place)
    cosine_image.read(emitter.source.value, place, light)
    cosine_image.slope(emitter.source.value, place, slope)
    slope /= np.float32(grid.step)
    return Laid(there=there, light=light, slope=slope, even=slope, away=None)


def derivatives(
    seen: Seen, scene: str, emitter: Emission, laid: Laid, number: int, turns: bool
) -> dict[str, Array]:
    """Derivatives of one emitter's light (n,) by the name of what they are with respect to."""

    def along(partial: Array) -> Array:
        return laid.slope[:, 0] * partial[:, 0] + laid.slope[:, 1] * partial[:, 1]

    by_name = partials(seen, scene, laid.there, number)
    if turns:
        by_name |= dict(zip(emission.TURN, emission.turn_partials(laid.there), strict=True))
    columns = {name: along(partial) for name, partial in by_name.items()}
    if isinstance(emitter.source, Lattice):
        names = (of_emitter(number) + name for name in _LATTICE)
        columns |= dict(zip(names, _lattice_columns(emitter.source, laid), strict=True))
    if emitter.absorbed is not None:
        for name in emitter.absorbed.partials:
            followed = along(emitter.absorbed.at(name, _known(laid.there)))
            columns[name] = columns.get(name, np.float32(0)) - followed
    return columns


def partials(seen: Seen, scene: str, there: emission.Directions, number: int) -> dict[str, Array]:
    """Derivatives (n, 2) of the cosines of one emitter by all that moves any pattern's dots."""
    places = (f"{of_emitter(number)}position.{axis}" for axis in emission.PLACE)
    by_name = dict(zip(places, emission.place_partials(there), strict=True))
    by_name[of_scene(scene)] = emission.scale_partial(there)
    if seen.side == "right":
        names = (f"right.{name}" for name in emission.RIGHT)
        by_name |= dict(zip(names, emission.right_partials(seen, there), strict=True))
    return by_name


def _known(there: emission.Directions) -> Array:
    """Cosines (n, 2), out of any field where nothing is known."""
    return np.where(np.isfinite(there.range_m)[:, None], there.cosines, np.float32(9))


def _lattice_columns(lattice: Lattice, laid: Laid) -> list[Array]:
    """By frequencies, phase and width: a step s = F a - phase moves the dot's place."""
    assert laid.away is not None
    of_steps = laid.even @ lattice.pitch.astype(np.float32)
    cosines = laid.there.cosines
    even = cosines * (1 - cosines @ lattice.keystone.astype(np.float32))[:, None]
    outwards = (laid.even * cosines).sum(axis=1)
    squared = (laid.away**2).sum(axis=1) / np.float32(lattice.sigma**3)
    return [
        *(of_steps[:, i] * even[:, j] for i in range(2) for j in range(2)),
        *(-of_steps[:, i] for i in range(2)),
        *(-outwards * cosines[:, i] for i in range(2)),
        laid.light * squared,
    ]


def moved(model: Model, step: NDArray[np.float64]) -> Model:
    """Move a model by a step (n,) of `Model.names`."""
    by_name = dict(zip(model.names, map(float, step), strict=True))
    emitters = tuple(
        _moved(one, np.array([by_name[of_emitter(k) + name] for name in own(one)]))
        for k, one in enumerate(model.emitters)
    )
    axes = Rotation.from_rotvec(model.rotation_deg, degrees=True)
    turn = [by_name.get(name, 0.0) for name in emission.TURN]
    x, y, z = (axes * Rotation.from_rotvec([*turn, 0.0])).as_rotvec(degrees=True)
    right = np.array([by_name[f"right.{name}"] for name in emission.RIGHT])
    return replace(
        model,
        emitters=emitters,
        rotation_deg=(float(x), float(y), float(z)),
        scales={scene: old + by_name[of_scene(scene)] for scene, old in model.scales.items()},
        alignment=Alignment.of(model.alignment.as_vector() + right),
    )


def _moved(emitter: Emission, step: NDArray[np.float64]) -> Emission:
    position, source = emitter.position_m + step[:3], emitter.source
    if isinstance(source, Lattice):
        wider = np.clip(
            source.sigma + step[11], source.sigma / _MOST_WIDER, source.sigma * _MOST_WIDER
        )
        source = Lattice(
            frequencies=source.frequencies + step[3:7].reshape(2, 2),
            phase=source.phase + step[7:9],
            keystone=source.keystone + step[9:11],
            sigma=float(wider),
        )
    return replace(emitter, position_m=position, source=source)
