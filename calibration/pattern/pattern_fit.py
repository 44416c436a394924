"""Fit emitters to captures: places, lattices, the scenes' pattern scales, the right image's rest.

Two emitters some millimetres apart lay two lattices that slide against each other with distance;
one image of a pattern cannot hold that. Fitting the lattices themselves needs few numbers, so that
few scenes are enough, and nothing of the scenes' own texture gets into the pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import emitter_model, room_equations, tile_equations
from starling.calibration.pattern.emission import Seen
from starling.calibration.pattern.emitter_model import Model
from starling.calibration.pattern.tile_equations import Normal
from starling.calibration.pattern.views import Array, View
from starling.sim.sensor.sensor import Sensor

# Dots are three pixels wide: every other row and column tells as much for its time, and fewer do
# until the dots are found.
_FIRST_EVERY_PX = 4
_EVERY_PX = 2
_TILE_PX = 32  # Of the image: some ten dots.
_SETTLED = 0.5  # Steps below this share of every standard deviation end the fit.
_FINE_STEPS = 4  # The last ones.
_ROUNDING = 1 / 12  # Variance of whole codes [DN^2].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Fitted:
    """A model, and how well it is known."""

    model: Model
    covariance: NDArray[np.float64]  # (n, n) of `model.names`.
    cost: tuple[float, ...]  # Robust mean squared residual before each step; 1 is noise alone.
    shares: NDArray[np.float64]  # (k,) of the emitters' light: their strengths' medians, sum 1.
    rooms: int = 1  # That the captures are of; from three on their differences are in `covariance`.

    def sd(self, name: str) -> float:
        """Standard deviation of one parameter."""
        i = self.model.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Sampled:
    """Every n-th row and column of a view."""

    scene: str
    room: str
    seen: Seen
    level: Array  # (h, w)
    weight: Array
    tile_px: int  # Of the pixels taken.


def fit(
    views: Sequence[View],
    sensor: Sensor,
    model: Model,
    *,
    steps: int = 12,
    only: Sequence[str] = (),
) -> Fitted:
    """Fit a model by Gauss-Newton steps with the tiles' levels and strengths eliminated.

    Args:
        views: of scenes that `model.scales` names.
        sensor: of the captures: noise, focal length.
        model: where to start; lattices within a quarter of their pitch.
        steps: at most, in all: those before the last four are taken on fewer pixels.
        only: names of what is freed; everything where none is named.

    Returns:
        The fitted model; its covariance is the larger one of two: a sandwich over the tiles'
        scores, which holds when residuals within a tile go together, and a jackknife over rooms,
        which holds when references are off by room.
    """
    held = np.array([bool(only) and name not in only for name in model.names])
    fine_steps = min(steps, _FINE_STEPS)
    costs: tuple[float, ...] = ()
    if steps > fine_steps:
        coarse = _samples(views, sensor, _FIRST_EVERY_PX)
        found = _settled(coarse, model, held, steps - fine_steps)
        model, costs = found.model, found.cost
    fine = _settled(_samples(views, sensor, _EVERY_PX), model, held, fine_steps)
    return replace(fine, cost=(*costs, *fine.cost))


def _settled(
    sampled: Sequence[_Sampled], model: Model, held: NDArray[np.bool_], steps: int
) -> Fitted:
    """Step until steps are small, at most so often."""
    costs: list[float] = []
    while True:
        rooms = _normals(sampled, model)
        normal = tile_equations.total(list(rooms.values()))
        costs.append(normal.misfit / max(normal.freedom, 1))
        step = room_equations.step(rooms, model, held)
        by_room = room_equations.jackknife(room_equations.moves(rooms, model, held))
        covariance = room_equations.widened_to(room_equations.by_tile(rooms, model, held), by_room)
        model = emitter_model.moved(model, step)
        small = np.abs(step) <= _SETTLED * np.sqrt(np.diagonal(covariance)) + 1e-12
        if small.all() or len(costs) == steps:
            break
    strengths = np.nanmedian(normal.strengths, axis=0)
    return Fitted(
        model=model,
        covariance=covariance,
        cost=tuple(costs),
        shares=strengths / max(strengths.sum(), 1e-12),
        rooms=len(rooms),
    )


def seen_of(view: View, sensor: Sensor, every_px: int = 1) -> Seen:
    """Take the surface points of a view's pixels, or of every n-th row and column of them."""
    height, width = view.level_dn.shape
    x = (np.arange(0, width, every_px) - sensor.cx_px) / sensor.fx_px
    y = (np.arange(0, height, every_px) - sensor.cy_px) / sensor.fy_px
    slopes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return Seen(
        points_m=np.ascontiguousarray(view.points_m[::every_px, ::every_px]).reshape(-1, 3),
        slopes=slopes.astype(np.float32),
        side=view.side,
        focal_px=sensor.fx_px,
    )


def _samples(views: Sequence[View], sensor: Sensor, every_px: int) -> list[_Sampled]:
    return [_sampled(view, sensor, every_px) for view in views]


def _sampled(view: View, sensor: Sensor, every_px: int) -> _Sampled:
    every = (slice(None, None, every_px), slice(None, None, every_px))
    level = np.ascontiguousarray(view.level_dn[every])
    above = np.maximum(level - np.float32(sensor.left.black_level_dn), 0)
    per_electron = sensor.left.dn_per_electron
    variance = _ROUNDING + (per_electron * sensor.left.read_noise_e) ** 2 + per_electron * above
    return _Sampled(
        scene=view.scene,
        room=view.room,
        seen=seen_of(view, sensor, every_px),
        level=level,
        weight=np.where(view.usable[every], 1 / variance, 0).astype(np.float32),
        tile_px=_TILE_PX // every_px,
    )


def _normals(sampled: Sequence[_Sampled], model: Model) -> dict[str, Normal]:
    """Normal equations of each room."""
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(lambda one: _normal_of(one, model), sampled))
    rooms: dict[str, list[Normal]] = {}
    for one, part in zip(sampled, parts, strict=True):
        rooms.setdefault(one.room, []).append(part)
    return {room: tile_equations.total(found) for room, found in rooms.items()}


def _normal_of(one: _Sampled, model: Model) -> Normal:
    names, shape = model.names, one.level.shape
    turns = "pitch" in names
    laid = emitter_model.lay(one.seen, model, model.scales[one.scene])
    by_name = [
        emitter_model.derivatives(one.seen, one.scene, emitter, light, number, turns)
        for number, (emitter, light) in enumerate(zip(model.emitters, laid, strict=True))
    ]
    used = [name for name in names if any(name in columns for columns in by_name)]
    columns = np.zeros((len(laid), len(used), *shape), np.float32)
    for number, found in enumerate(by_name):
        for name, column in found.items():
            columns[number, used.index(name)] = np.nan_to_num(column).reshape(shape)
    lights = np.stack([light.light.reshape(shape) for light in laid])
    normal = tile_equations.of(one.level, one.weight, lights, columns, tile_px=one.tile_px)
    return tile_equations.widened(normal, [names.index(name) for name in used], len(names))
