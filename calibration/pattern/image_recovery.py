"""Recover a pattern that is an image, and where its emitter stands: solved in turn.

An image follows its emitter, but for how views of other distances differ. Each round takes one
Gauss-Newton step of the place, of which is left out what the image takes over, and solves the image
anew from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import (
    absorbed,
    emission,
    emitter_model,
    image_equations,
    modulation,
    pattern_fit,
    room_equations,
    tile_equations,
    unprojected,
)
from starling.calibration.pattern.absorbed import Absorbed
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.modulation import Modulation
from starling.calibration.pattern.pattern_fit import Fitted
from starling.calibration.pattern.tile_equations import Normal
from starling.calibration.pattern.unprojected import PatternImage, Placed
from starling.calibration.pattern.views import Array, View
from starling.sim.console import progress
from starling.sim.render import emission as light
from starling.sim.sensor.sensor import Sensor

_TEXELS_PER_PIXEL = 0.9  # Of the pattern's image, over the imager's pixels on the axis.
_MARGIN = 1.02  # The grid's extent over the field's.
_EVERY_PX = 3  # Pixels between those that tell what an image absorbs.
_TILE_PX = 32  # Residuals within a tile go together.
_SETTLED = 0.2  # A step below this share of every standard deviation ends the rounds.
_NOWHERE = np.float32(-9)  # A cosine, or a grid's pixel, outside of any image.
_MOST_PARTS = 5  # That rooms are divided into, to leave one out at a time.

Modulations = Mapping[int, Modulation]  # By the identity of the view.


def modulations(views: Sequence[View], sensor: Sensor) -> Modulations:
    """Take reflectance and level out of views, as their sensor's noise allows."""
    return {
        id(view): modulation.of(
            view,
            dn_per_electron=sensor.left.dn_per_electron,
            black_level_dn=sensor.left.black_level_dn,
        )
        for view in views
    }


def imager_blur_px(sensor: Sensor) -> float:
    """Sigma by which the imager itself widens a dot [px]: lens, pixel and resampling."""
    return float(np.sqrt(sensor.left.lens.blur_px**2 + sensor.left.smoothing_px**2 + 1 / 12))


def grid_of(sensor: Sensor) -> Grid:
    """The grid of a pattern's image that fills a sensor's projected field."""
    half_x, half_y = (_MARGIN * half for half in light.half_tangents(sensor.projector))
    return Grid(
        half_a=half_x / np.hypot(1, half_x),
        half_b=half_y / np.hypot(1, half_y),
        step=1 / (_TEXELS_PER_PIXEL * sensor.fx_px),
    )


def image(
    views: Sequence[View],
    sensor: Sensor,
    model: Model,
    position_m: NDArray[np.float64],
    seen: Modulations,
    start: PatternImage | None = None,
) -> PatternImage:
    """Solve for the pattern as an image, all else as a model has it.

    Args:
        views: of lit surfaces.
        sensor: of the captures.
        model: its turn, scales and alignment count.
        position_m: (3,) of the emitter.
        seen: the views' modulations.
        start: to go on from; it is settled after one more round of gains.
    """
    placed = []
    for view in views:
        there = emission.directions(
            pattern_fit.seen_of(view, sensor).moved(model.alignment),
            position_m=position_m,
            rotation_deg=model.rotation_deg,
            scale=model.scales[view.scene],
        )
        placed.append(_placed(there.cosines, seen[id(view)], sensor))
    if start is None:
        return unprojected.solve(placed, grid_of(sensor))
    return unprojected.solve(placed, start.grid, start=start.value, rounds=1)


def settled(
    views: Sequence[View],
    sensor: Sensor,
    model: Model,
    *,
    rounds: int,
    track: progress.Progress = progress.silent,
) -> Fitted:
    """Take rounds of place and image until the place stays, and say how sure it is.

    Args:
        views: of scenes that `model.scales` names.
        sensor: of the captures.
        model: with one emitter, of an image, to begin from.
        rounds: at most.
        track: wraps the loop over rounds.

    Returns:
        The model; its variances are those of a sandwich over tiles and of a jackknife, for which
        image and place are solved anew without each room (or each fifth of them) from three rooms
        on, together. What all rooms share, as what the image's grid does, is in neither.
    """
    seen = modulations(views, sensor)
    free = np.zeros(len(model.names), bool)
    whole, covariance = np.eye(len(free)), np.zeros((len(free), len(free)))
    costs: list[float] = []
    last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    done = False
    for _ in track(range(rounds), "pattern"):
        if done:
            continue
        rooms = _equations(views, sensor, model, seen)
        normal = tile_equations.total(list(rooms.values()))
        costs.append(normal.misfit / max(normal.freedom, 1))
        step = room_equations.step(rooms, model, free)
        if last is not None:
            whole = room_equations.lengthening(normal.matrix, *last, step)
        covariance = whole @ room_equations.by_tile(rooms, model, free) @ whole.T
        last = whole @ step, step
        model = _with_image(views, sensor, emitter_model.moved(model, last[0]), seen)
        done = bool((np.abs(last[0]) <= _SETTLED * np.sqrt(np.diagonal(covariance)) + 1e-12).all())
    # An image takes over noise, which tiles' scores then miss: rooms' variance is added.
    by_room = room_equations.jackknife([whole @ m for m in _moves(views, sensor, model, seen)])
    variance = np.diagonal(covariance) + by_room
    return Fitted(
        model=model,
        covariance=room_equations.widened_to(covariance, variance),
        cost=tuple(costs),
        shares=np.ones(1),
        rooms=len({view.room for view in views}),
    )


def _moves(
    views: Sequence[View], sensor: Sensor, model: Model, seen: Modulations
) -> list[NDArray[np.float64]]:
    """Where image and place go without each part of the rooms; none from too few rooms."""
    rooms = tuple(dict.fromkeys(view.room for view in views))
    if len(rooms) < room_equations.LEAST_ROOMS:
        return []
    count = min(len(rooms), _MOST_PARTS)
    out = []
    for number in range(count):
        rest = [view for view in views if view.room not in rooms[number::count]]
        without = _with_image(rest, sensor, model, seen)
        equations = _equations(rest, sensor, without, seen)
        left = {view.scene for view in rest}
        held = np.array([emitter_model.scene_of(n) not in {"", *left} for n in model.names])
        out.append(room_equations.step(equations, without, held))
    return out


def _with_image(views: Sequence[View], sensor: Sensor, model: Model, seen: Modulations) -> Model:
    """The model with its image solved anew from where its emitter is."""
    (emitter,) = model.emitters
    assert isinstance(emitter.source, PatternImage)
    found = image(views, sensor, model, emitter.position_m, seen, emitter.source)
    return replace(model, emitters=(replace(emitter, source=found),))


def _equations(
    views: Sequence[View], sensor: Sensor, model: Model, seen: Modulations
) -> dict[str, Normal]:
    """Normal equations of each room, of an emitter whose image follows it."""
    (emitter,) = model.emitters
    assert isinstance(emitter.source, PatternImage)
    taken = _absorbed(views, sensor, model, emitter.source.grid, seen)
    follows = replace(emitter, absorbed=taken)
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(lambda view: _equation(view, sensor, model, follows, seen), views))
    rooms: dict[str, list[Normal]] = {}
    for view, part in zip(views, parts, strict=True):
        rooms.setdefault(view.room, []).append(part)
    return {room: tile_equations.total(found) for room, found in rooms.items()}


def _equation(
    view: View, sensor: Sensor, model: Model, follows: Emission, seen: Modulations
) -> Normal:
    source, shape, names = follows.source, view.level_dn.shape, model.names
    assert isinstance(source, PatternImage)
    points = pattern_fit.seen_of(view, sensor)
    (laid,) = emitter_model.lay(points, model, model.scales[view.scene])
    columns = emitter_model.derivatives(points, view.scene, follows, laid, 0, turns=False)
    placed = _placed(source.grid.place(laid.there.cosines), seen[id(view)], sensor)
    normal = image_equations.of(
        unprojected.with_gain(placed, source.value),
        laid.light.reshape(shape),
        {name: np.nan_to_num(column).reshape(shape) for name, column in columns.items()},
        tile_px=_TILE_PX,
    )
    return tile_equations.widened(normal, [names.index(name) for name in columns], len(names))


def _placed(places: Array, modulated: Modulation, sensor: Sensor) -> Placed:
    """A view where its pixels look, as cosines or on a grid; far out where nothing is known."""
    known = np.where(np.isfinite(places), places, _NOWHERE)
    return Placed(modulation=modulated, cosines=known, blur_px=imager_blur_px(sensor))


def _absorbed(
    views: Sequence[View], sensor: Sensor, model: Model, grid: Grid, modulated: Modulations
) -> Absorbed:
    every = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    parts = []
    for view in views:
        seen = pattern_fit.seen_of(view, sensor, _EVERY_PX)
        (laid,) = emitter_model.lay(seen, model, model.scales[view.scene])
        there = laid.there.cosines
        cosines = np.where(np.isfinite(there), there, _NOWHERE)
        weight = modulated[id(view)].weight[every].ravel()
        parts.append((cosines, weight, emitter_model.partials(seen, view.scene, laid.there, 0)))
    return absorbed.of(parts, grid)
