"""Recover a pattern image and the position of its emitter alternately.

A re-solved image follows its emitter, except for differences between views at different distances.
Each round takes one Gauss-Newton step of the position, without the motion that the image absorbs.
It then solves for the image at the new position.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import (
    emission,
    emitter_model,
    pattern_fit,
    room_equations,
    tile_equations,
    unprojected,
)
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import (
    AbsorbedMotion,
    EmitterModel,
    PatternEmitter,
)
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.tile_equations import NormalEquations
from starling.calibration.pattern.unprojected import PatternImage, PlacedView
from starling.calibration.pattern.views import Array, Modulation, PatternView, modulate
from starling.sim.console import progress
from starling.sim.render.emission import half_tangents
from starling.sim.sensor.sensor import Sensor

_TEXELS_PER_PIXEL = 0.9  # Pixels of the pattern image per imager pixel, on the axis.
_MARGIN = 1.02  # Extent of the grid over that of the field.
_EVERY_PX = 3  # Sampling step for the absorbed motion.
_TILE_PX = 32  # Side of a tile; residuals within a tile are correlated.
_SETTLED = 0.2  # Step below which the rounds end [standard deviations].
_NOWHERE = np.float32(-9)  # A cosine or grid coordinate outside any image.
_MOST_PARTS = 5  # Maximum number of groups of rooms in the jackknife.

Modulations = Mapping[int, Modulation]  # By the identity of the view.


def modulations(views: Sequence[PatternView], sensor: Sensor) -> Modulations:
    """Normalise views by local mean and deviation, with weights from the sensor's noise."""
    return {
        id(view): modulate(
            view,
            dn_per_electron=sensor.left.dn_per_electron,
            black_level_dn=sensor.left.black_level_dn,
        )
        for view in views
    }


def imager_blur_px(sensor: Sensor) -> float:
    """Return the sigma of the imager's blur [px]: lens, pixel and resampling."""
    return float(np.sqrt(sensor.left.lens.blur_px**2 + sensor.left.smoothing_px**2 + 1 / 12))


def make_grid(sensor: Sensor) -> Grid:
    """Return the grid of a pattern image over the projector's field."""
    half_x, half_y = (_MARGIN * half for half in half_tangents(sensor.projector))
    return Grid(
        half_a=half_x / np.hypot(1, half_x),
        half_b=half_y / np.hypot(1, half_y),
        step=1 / (_TEXELS_PER_PIXEL * sensor.fx_px),
    )


def solve_image(
    views: Sequence[PatternView],
    sensor: Sensor,
    model: EmitterModel,
    position_m: NDArray[np.float64],
    modulated: Modulations,
    start: PatternImage | None = None,
) -> PatternImage:
    """Solve for the pattern as an image, with all other parameters fixed.

    Args:
        views: views of surfaces with the projector on.
        sensor: sensor of the captures.
        model: model with rotation, scales and alignment.
        position_m: (3,) position of the emitter.
        modulated: modulations of the views.
        start: initial image; it needs only one round of gains.
    """
    placed = []
    for view in views:
        rays = emission.directions(
            pattern_fit.surface_points(view, sensor).shifted(model.alignment),
            position_m=position_m,
            rotation_deg=model.rotation_deg,
            scale=model.scales[view.scene],
        )
        placed.append(_place(rays.cosines, modulated[id(view)], sensor))
    if start is None:
        return unprojected.solve(placed, make_grid(sensor))
    return unprojected.solve(placed, start.grid, start=start.value, rounds=1)


def fit_image(
    views: Sequence[PatternView],
    sensor: Sensor,
    model: EmitterModel,
    *,
    rounds: int,
    track: progress.Progress = progress.silent,
) -> PatternFit:
    """Alternate position and image until the position converges; estimate the covariance.

    Args:
        views: views of the scenes in `model.scales`.
        sensor: sensor of the captures.
        model: initial model, with one emitter that has an image.
        rounds: maximum number of rounds.
        track: progress callback around the loop over rounds.

    Returns:
        The fitted model. Its variance is the sum of a sandwich over tiles and, from three rooms
        on, a jackknife. The jackknife solves image and position again without each room, or
        without each fifth of the rooms. Errors common to all rooms, as from the image's grid, are
        not included.
    """
    modulated = modulations(views, sensor)
    free = np.zeros(len(model.names), bool)
    correction, covariance = np.eye(len(free)), np.zeros((len(free), len(free)))
    costs: list[float] = []
    last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    converged = False
    for _ in track(range(rounds), "pattern"):
        if converged:
            continue
        rooms = _equations(views, sensor, model, modulated)
        normal = tile_equations.total(list(rooms.values()))
        costs.append(normal.misfit / max(normal.freedom, 1))
        step = room_equations.gauss_newton_step(rooms, model, free)
        if last is not None:
            correction = room_equations.step_correction(normal.matrix, *last, step)
        covariance = correction @ room_equations.tile_covariance(rooms, model, free) @ correction.T
        last = correction @ step, step
        model = _with_image(views, sensor, emitter_model.apply_step(model, last[0]), modulated)
        converged = bool(
            (np.abs(last[0]) <= _SETTLED * np.sqrt(np.diagonal(covariance)) + 1e-12).all()
        )
    # The image absorbs noise that the tiles' scores then miss, so the room variance is added.
    steps = _leave_out_steps(views, sensor, model, modulated)
    room_variance = room_equations.jackknife([correction @ step for step in steps])
    variance = np.diagonal(covariance) + room_variance
    return PatternFit(
        model=model,
        covariance=room_equations.with_variances(covariance, variance),
        cost=tuple(costs),
        shares=np.ones(1),
        rooms=len({view.room for view in views}),
    )


def _leave_out_steps(
    views: Sequence[PatternView], sensor: Sensor, model: EmitterModel, modulated: Modulations
) -> list[NDArray[np.float64]]:
    """Return the step of the fit without each group of rooms; empty for too few rooms."""
    rooms = tuple(dict.fromkeys(view.room for view in views))
    if len(rooms) < room_equations.LEAST_ROOMS:
        return []
    count = min(len(rooms), _MOST_PARTS)
    steps = []
    for number in range(count):
        rest = [view for view in views if view.room not in rooms[number::count]]
        without = _with_image(rest, sensor, model, modulated)
        equations = _equations(rest, sensor, without, modulated)
        remaining_scenes = {view.scene for view in rest}
        held = np.array(
            [
                emitter_model.scene_from_name(name) not in {"", *remaining_scenes}
                for name in model.names
            ]
        )
        steps.append(room_equations.gauss_newton_step(equations, without, held))
    return steps


def _with_image(
    views: Sequence[PatternView], sensor: Sensor, model: EmitterModel, modulated: Modulations
) -> EmitterModel:
    """Return the model with its image re-solved at the emitter's position."""
    (emitter,) = model.emitters
    assert isinstance(emitter.source, PatternImage)
    source = solve_image(views, sensor, model, emitter.position_m, modulated, emitter.source)
    return replace(model, emitters=(replace(emitter, source=source),))


def _equations(
    views: Sequence[PatternView], sensor: Sensor, model: EmitterModel, modulated: Modulations
) -> dict[str, NormalEquations]:
    """Return the normal equations of each room, for an emitter whose image follows it."""
    (emitter,) = model.emitters
    assert isinstance(emitter.source, PatternImage)
    motion = _average_motion(views, sensor, model, emitter.source.grid, modulated)
    following = replace(emitter, absorbed=motion)
    return room_equations.reduce_rooms(
        views, lambda view: _equation(view, sensor, model, following, modulated)
    )


def _equation(
    view: PatternView,
    sensor: Sensor,
    model: EmitterModel,
    following: PatternEmitter,
    modulated: Modulations,
) -> NormalEquations:
    source, shape, names = following.source, view.level_dn.shape, model.names
    assert isinstance(source, PatternImage)
    points = pattern_fit.surface_points(view, sensor)
    (emitter_light,) = emitter_model.illuminate(points, model, model.scales[view.scene])
    columns = emitter_model.derivatives(
        points, view.scene, following, emitter_light, 0, turns=False
    )
    placed = _place(source.grid.place(emitter_light.rays.cosines), modulated[id(view)], sensor)
    normal = tile_equations.reduce_view(
        unprojected.with_gain(placed, source.value),
        emitter_light.light.reshape(shape),
        {name: np.nan_to_num(column).reshape(shape) for name, column in columns.items()},
        tile_px=_TILE_PX,
    )
    return tile_equations.embed(normal, [names.index(name) for name in columns], len(names))


def _place(coordinates: Array, modulated: Modulation, sensor: Sensor) -> PlacedView:
    """Return a view with the coordinates of its pixels; unknown ones lie outside any image."""
    known = np.where(np.isfinite(coordinates), coordinates, _NOWHERE)
    return PlacedView(modulation=modulated, cosines=known, blur_px=imager_blur_px(sensor))


def _average_motion(
    views: Sequence[PatternView],
    sensor: Sensor,
    model: EmitterModel,
    grid: Grid,
    modulated: Modulations,
) -> AbsorbedMotion:
    sparse = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    parts = []
    for view in views:
        surface = pattern_fit.surface_points(view, sensor, _EVERY_PX)
        (emitter_light,) = emitter_model.illuminate(surface, model, model.scales[view.scene])
        directions = emitter_light.rays.cosines
        cosines = np.where(np.isfinite(directions), directions, _NOWHERE)
        weight = modulated[id(view)].weight[sparse].ravel()
        parts.append(
            (cosines, weight, emitter_model.partials(surface, view.scene, emitter_light.rays, 0))
        )
    return emitter_model.average_motion(parts, grid)
