"""Fit emitters to captures: positions, lattices, pattern scales, alignment of the right image.

Two emitters a few millimetres apart project two lattices that shift against each other with
distance. One pattern image cannot represent this. Lattices have few parameters, so few scenes are
enough, and scene texture does not enter the pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import emitter_model, room_equations, tile_equations
from starling.calibration.pattern.emission import SurfacePoints
from starling.calibration.pattern.emitter_model import EmitterModel
from starling.calibration.pattern.tile_equations import NormalEquations
from starling.calibration.pattern.views import Array, PatternView
from starling.sim.sensor.sensor import Sensor

# Dots are three pixels wide, so every second row and column is enough, and every fourth at first.
_FIRST_EVERY_PX = 4
_EVERY_PX = 2
_TILE_PX = 32  # Side of a tile; it contains about ten dots.
_SETTLED = 0.5  # Step below which the fit ends [standard deviations].
_FINE_STEPS = 4  # Number of final steps at `_EVERY_PX`.
_ROUNDING = 1 / 12  # Quantisation variance [DN^2].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PatternFit:
    """A fitted model with its covariance."""

    model: EmitterModel
    covariance: NDArray[np.float64]  # (n, n) in the order of `model.names`.
    cost: tuple[float, ...]  # Robust mean squared residual before each step; noise alone gives 1.
    shares: NDArray[np.float64]  # (k,) share of light of each emitter (median strength), sum 1.
    rooms: int = 1  # Number of rooms; from three on, `covariance` includes their scatter.

    def sd(self, name: str) -> float:
        """Standard deviation of one parameter."""
        i = self.model.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _SampledView:
    """A view, subsampled by rows and columns."""

    scene: str
    room: str
    surface: SurfacePoints
    level: Array  # (h, w)
    weight: Array
    tile_px: int  # Side of a tile in sampled pixels.


def fit(
    views: Sequence[PatternView],
    sensor: Sensor,
    model: EmitterModel,
    *,
    steps: int = 12,
    only: Sequence[str] = (),
) -> PatternFit:
    """Fit a model by Gauss-Newton steps; levels and strengths of tiles are eliminated.

    Args:
        views: views of the scenes in `model.scales`.
        sensor: sensor of the captures (noise, focal length).
        model: initial model, with lattices within a quarter of their pitch.
        steps: maximum number of steps; steps before the last four use fewer pixels.
        only: names of the free parameters; empty frees all.

    Returns:
        The fitted model. Its variances are the larger of two estimates. A sandwich over tiles
        allows for correlated residuals within a tile. A jackknife over rooms allows for reference
        errors by room.
    """
    held = np.array([bool(only) and name not in only for name in model.names])
    fine_steps = min(steps, _FINE_STEPS)
    costs: tuple[float, ...] = ()
    if steps > fine_steps:
        coarse = [_sample(view, sensor, _FIRST_EVERY_PX) for view in views]
        coarse_fit = _iterate(coarse, model, held, steps - fine_steps)
        model, costs = coarse_fit.model, coarse_fit.cost
    fine = [_sample(view, sensor, _EVERY_PX) for view in views]
    fitted = _iterate(fine, model, held, fine_steps)
    return replace(fitted, cost=(*costs, *fitted.cost))


def _iterate(
    sampled: Sequence[_SampledView], model: EmitterModel, held: NDArray[np.bool_], steps: int
) -> PatternFit:
    """Iterate until steps are small, or up to a maximum number of steps."""
    costs: list[float] = []
    while True:
        rooms = room_equations.reduce_rooms(sampled, partial(_view_equations, model=model))
        normal = tile_equations.total(list(rooms.values()))
        costs.append(normal.misfit / max(normal.freedom, 1))
        step = room_equations.gauss_newton_step(rooms, model, held)
        by_room = room_equations.jackknife(room_equations.leave_one_out_steps(rooms, model, held))
        covariance = room_equations.with_variances(
            room_equations.tile_covariance(rooms, model, held), by_room
        )
        model = emitter_model.apply_step(model, step)
        is_small = np.abs(step) <= _SETTLED * np.sqrt(np.diagonal(covariance)) + 1e-12
        if is_small.all() or len(costs) == steps:
            break
    strengths = np.nanmedian(normal.strengths, axis=0)
    return PatternFit(
        model=model,
        covariance=covariance,
        cost=tuple(costs),
        shares=strengths / max(strengths.sum(), 1e-12),
        rooms=len(rooms),
    )


def surface_points(view: PatternView, sensor: Sensor, every_px: int = 1) -> SurfacePoints:
    """Return the surface points of a view's pixels, or of every n-th row and column."""
    height, width = view.level_dn.shape
    x = (np.arange(0, width, every_px) - sensor.cx_px) / sensor.fx_px
    y = (np.arange(0, height, every_px) - sensor.cy_px) / sensor.fy_px
    slopes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return SurfacePoints(
        points_m=np.ascontiguousarray(view.points_m[::every_px, ::every_px]).reshape(-1, 3),
        slopes=slopes.astype(np.float32),
        side=view.side,
        focal_px=sensor.fx_px,
    )


def _sample(view: PatternView, sensor: Sensor, every_px: int) -> _SampledView:
    sparse = (slice(None, None, every_px), slice(None, None, every_px))
    level = np.ascontiguousarray(view.level_dn[sparse])
    above = np.maximum(level - np.float32(sensor.left.black_level_dn), 0)
    per_electron = sensor.left.dn_per_electron
    variance = _ROUNDING + (per_electron * sensor.left.read_noise_e) ** 2 + per_electron * above
    return _SampledView(
        scene=view.scene,
        room=view.room,
        surface=surface_points(view, sensor, every_px),
        level=level,
        weight=np.where(view.usable[sparse], 1 / variance, 0).astype(np.float32),
        tile_px=_TILE_PX // every_px,
    )


def _view_equations(view: _SampledView, model: EmitterModel) -> NormalEquations:
    names, shape = model.names, view.level.shape
    has_rotation = "pitch" in names
    emitter_lights = emitter_model.illuminate(view.surface, model, model.scales[view.scene])
    by_name = [
        emitter_model.derivatives(view.surface, view.scene, emitter, light, number, has_rotation)
        for number, (emitter, light) in enumerate(zip(model.emitters, emitter_lights, strict=True))
    ]
    used = [name for name in names if any(name in columns for columns in by_name)]
    columns = np.zeros((len(emitter_lights), len(used), *shape), np.float32)
    for number, emitter_columns in enumerate(by_name):
        for name, column in emitter_columns.items():
            columns[number, used.index(name)] = np.nan_to_num(column).reshape(shape)
    templates = np.stack([light.light.reshape(shape) for light in emitter_lights])
    normal = tile_equations.reduce_image(
        view.level, view.weight, templates, columns, tile_px=view.tile_px
    )
    return tile_equations.embed(normal, [names.index(name) for name in used], len(names))
