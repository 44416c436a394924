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
from scipy import stats

from calibration.pattern import emitter_model, tile_equations
from calibration.pattern.emission import Seen
from calibration.pattern.emitter_model import Model
from calibration.pattern.tile_equations import Normal
from calibration.pattern.views import Array, View
from sim.sensor import Sensor

# Dots are three pixels wide: every other row and column tells as much for its time, and fewer do
# until the dots are found.
_FIRST_EVERY_PX = 4
_EVERY_PX = 2
_TILE_PX = 32  # Of the image: some ten dots.
_SETTLED = 0.5  # Steps below this share of every standard deviation end the fit.
_FINE_STEPS = 4  # At most, after the coarse ones.
_LEAST_ROOMS = 3  # Fewer say nothing of how rooms differ.
_QUANTILE = 0.95  # At which Student's and the normal distribution are made alike.
_ROUNDING = 1 / 12  # Variance of whole codes [DN^2].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Fitted:
    """A model, and how well it is known."""

    model: Model
    covariance: NDArray[np.float64]  # (n, n) of `model.names`.
    cost: tuple[float, ...]  # Weighted mean squared residual before each step.
    shares: NDArray[np.float64]  # (k,) of the emitters' light: their strengths' medians, sum 1.

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
    steps: int = 8,
    only: Sequence[str] = (),
) -> Fitted:
    """Fit a model by Gauss-Newton steps with the tiles' levels and strengths eliminated.

    Args:
        views: of scenes that `model.scales` names.
        sensor: of the captures: noise, focal length.
        model: where to start; lattices within a quarter of their pitch.
        steps: at most, on few pixels; then up to four on all that count.
        only: names of what is freed; everything where none is named.

    Returns:
        The fitted model; its covariance is the larger one of two: a sandwich over the tiles'
        scores, which holds when residuals within a tile go together, and a jackknife over rooms,
        which holds when references are off by room.
    """
    held = np.array([bool(only) and name not in only for name in model.names])
    coarse = _settled(_samples(views, sensor, _FIRST_EVERY_PX), model, held, steps)
    fine = _settled(_samples(views, sensor, _EVERY_PX), coarse.model, held, _FINE_STEPS)
    return replace(fine, cost=(*coarse.cost, *fine.cost))


def _settled(
    sampled: Sequence[_Sampled], model: Model, held: NDArray[np.bool_], steps: int
) -> Fitted:
    """Step until steps are small, at most so often."""
    costs: list[float] = []
    while True:
        normals = _normals(sampled, model)
        normal = tile_equations.total(list(normals.values()))
        costs.append(normal.squares / max(normal.count, 1))
        gauge = np.zeros_like(normal.matrix) if held.any() else _gauge(normal, model)
        matrix, right_side = _solvable(normal.matrix + gauge, normal.right_side, held)
        off = np.array([model.scales.get(emitter_model.scene_of(n), 1) - 1 for n in model.names])
        inverse = np.linalg.inv(matrix)
        step = inverse @ (right_side - gauge @ off)
        covariance = _covariance(normals, gauge, held)
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


def _gauge(normal: Normal, model: Model) -> NDArray[np.float64]:
    """Weight (n, n) that holds the scenes' mean scale at 1: the pattern's own trades with it."""
    scales = [emitter_model.of_scene(scene) for scene in model.scales]
    among = np.array([name in scales for name in model.names], np.float64)
    stiff = 1e3 * np.diagonal(normal.matrix)[among > 0].max(initial=1.0)
    return stiff * np.outer(among, among)


def _solvable(
    matrix: NDArray[np.float64], right_side: NDArray[np.float64], held: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Leave where it is what is held, and what no view tells."""
    silent = held | (np.diagonal(matrix) == 0)
    matrix, right_side = matrix.copy(), np.where(silent, 0.0, right_side)
    matrix[silent], matrix[:, silent] = 0.0, 0.0
    matrix[silent, silent] = 1.0
    return matrix, right_side


def _covariance(
    normals: dict[str, Normal], gauge: NDArray[np.float64], held: NDArray[np.bool_]
) -> NDArray[np.float64]:
    normal = tile_equations.total(list(normals.values()))
    matrix, _ = _solvable(normal.matrix + gauge, normal.right_side, held)
    inverse = np.linalg.inv(matrix)
    scores = np.where(held, 0.0, normal.scores)
    by_tile = inverse @ (scores.T @ scores) @ inverse
    if len(normals) < _LEAST_ROOMS:
        return by_tile
    moves = []
    for part in normals.values():  # One step towards the fit without each room.
        others = normal.matrix - part.matrix + gauge
        left, side = _solvable(others, normal.right_side - part.right_side, held)
        own = np.diagonal(part.matrix) > 0
        alone = own & (np.diagonal(normal.matrix - part.matrix) <= 0)
        left, side = _solvable(left, side, held | alone)
        moves.append(np.linalg.solve(left, side))
    count = len(moves)
    spread = np.array(moves) - np.mean(moves, axis=0)
    # Few rooms say little of how rooms differ: Student's intervals are the wider for it.
    student = stats.t.ppf(_QUANTILE, count - 1) / stats.norm.ppf(_QUANTILE)
    by_room = student**2 * (count - 1) / count * spread.T @ spread
    larger = np.sqrt(np.maximum(np.diagonal(by_room) / np.diagonal(by_tile).clip(1e-300), 1.0))
    return by_tile * np.outer(larger, larger)
