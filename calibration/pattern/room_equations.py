"""Steps and covariances of a model from the normal equations of each room."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.pattern import emitter_model, tile_equations
from starling.calibration.pattern.emitter_model import EmitterModel
from starling.calibration.pattern.tile_equations import NormalEquations

LEAST_ROOMS = 3  # Minimum number of rooms for a jackknife.
_QUANTILE = 0.95  # Quantile at which Student's and the normal distribution are matched.

_LEAST_SHARE = 0.2  # Minimum attenuation of a step; smaller values do not differ from 0.

Rooms = Mapping[str, NormalEquations]
Held = NDArray[np.bool_]  # (n,) mask of the fixed parameters in `EmitterModel.names`.
Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


def reduce_rooms(
    views: Sequence[Any], reduce: Callable[[Any], NormalEquations]
) -> dict[str, NormalEquations]:
    """Return the normal equations of each room.

    Args:
        views: views with their `room`.
        reduce: returns the equations of a view; it runs in two threads.
    """
    with ThreadPoolExecutor(2) as pool:
        equations = list(pool.map(reduce, views))
    rooms: dict[str, list[NormalEquations]] = {}
    for view, view_equations in zip(views, equations, strict=True):
        rooms.setdefault(view.room, []).append(view_equations)
    return {room: tile_equations.total(parts) for room, parts in rooms.items()}


def gauss_newton_step(rooms: Rooms, model: EmitterModel, held: Held) -> Vector:
    """Return the Gauss-Newton step (n,); it is 0 for parameters that no view depends on."""
    normal = tile_equations.total(list(rooms.values()))
    gauge = _gauge(normal, model, held)
    matrix, right_side = _solvable(normal.matrix + gauge, normal.right_side, held)
    scale_error = sum(model.scales.values()) - len(model.scales)
    return np.linalg.inv(matrix) @ (right_side - scale_error * gauge.max(axis=1))


def tile_covariance(rooms: Rooms, model: EmitterModel, held: Held) -> Matrix:
    """Return the sandwich covariance (n, n), robust to correlated residuals within a tile.

    Source: White, Econometrica 50, 1982; Liang and Zeger, Biometrika 73, 1986.
    """
    normal = tile_equations.total(list(rooms.values()))
    matrix, _ = _solvable(normal.matrix + _gauge(normal, model, held), normal.right_side, held)
    inverse = np.linalg.inv(matrix)
    scores = np.where(held, 0.0, normal.scores)
    return inverse @ (scores.T @ scores) @ inverse


def leave_one_out_steps(rooms: Rooms, model: EmitterModel, held: Held) -> list[Vector]:
    """Return, for each room, one step towards the fit to the other rooms."""
    normal = tile_equations.total(list(rooms.values()))
    gauge = _gauge(normal, model, held)
    steps = []
    for room in rooms.values():
        rest = np.diagonal(normal.matrix - room.matrix)
        only_here = (np.diagonal(room.matrix) > 0) & (rest <= 0)  # Parameters of this room only.
        matrix, right_side = _solvable(
            normal.matrix - room.matrix + gauge,
            normal.right_side - room.right_side,
            held | only_here,
        )
        steps.append(np.linalg.solve(matrix, right_side))
    return steps


def jackknife(steps: Sequence[Vector]) -> Vector:
    """Return jackknife variances (n,) from leave-one-out fits; 0 for less than three parts.

    A Student factor widens the variances for few parts.

    Args:
        steps: (n,) step of the fit without each part.

    Source: Efron, The Jackknife, the Bootstrap and Other Resampling Plans (1982), ch. 3.
    """
    count = len(steps)
    if count < LEAST_ROOMS:
        return np.zeros(len(steps[0]) if steps else 1)
    spread = np.array(steps) - np.mean(steps, axis=0)
    student = stats.t.ppf(_QUANTILE, count - 1) / stats.norm.ppf(_QUANTILE)
    return np.asarray(student**2 * (count - 1) / count * (spread**2).sum(axis=0), np.float64)


def with_variances(covariance: Matrix, variance: Vector) -> Matrix:
    """Raise the variances of a covariance (n, n) to `variance` (n,); keep its correlations."""
    factor = np.sqrt(np.maximum(variance / np.diagonal(covariance).clip(1e-300), 1.0))
    return covariance * np.outer(factor, factor)


def step_correction(matrix: Matrix, applied: Vector, before: Vector, after: Vector) -> Matrix:
    """Return the matrix that corrects attenuated steps (n,) along the last step.

    Noise in the derivatives increases the matrix of the normal equations but not the right side.
    Along poorly determined directions, steps and deviations are then too small by a factor. The
    change from one step to the next gives this factor.

    Args:
        matrix: (n, n) matrix of the normal equations, as a measure of length.
        applied: (n,) last step, as applied.
        before: (n,) last step from the equations.
        after: (n,) next step from the equations.

    Source: Broyden, Mathematics of Computation 19, 1965 (a rank-one correction by a secant);
    Fuller, Measurement Error Models (1987), ch. 1 (attenuation).
    """
    applied_gradient = matrix @ applied
    length = float(applied @ applied_gradient)
    if length <= 0:
        return np.eye(len(applied))
    share = float(np.clip((before - after) @ applied_gradient / length, _LEAST_SHARE, 1.0))
    return np.eye(len(applied)) + (1 / share - 1) * np.outer(applied, applied_gradient) / length


def _gauge(normal: NormalEquations, model: EmitterModel, held: Held) -> Matrix:
    """Return the weight (n, n) that fixes the scenes' mean scale at 1.

    The mean scale and the pattern's scale are not separable. If the pattern is fixed, the weight
    is 0.
    """
    scales = np.array([bool(emitter_model.scene_from_name(name)) for name in model.names])
    if (held & ~scales).any():
        return np.zeros_like(normal.matrix)
    free_scales = (scales & ~held).astype(np.float64)
    weight = 1e3 * np.diagonal(normal.matrix)[free_scales > 0].max(initial=1.0)
    return weight * np.outer(free_scales, free_scales)


def _solvable(matrix: Matrix, right_side: Vector, held: Held) -> tuple[Matrix, Vector]:
    """Remove fixed parameters and parameters that no view depends on from the equations."""
    fixed = held | (np.diagonal(matrix) == 0)
    matrix, right_side = matrix.copy(), np.where(fixed, 0.0, right_side)
    matrix[fixed], matrix[:, fixed] = 0.0, 0.0
    matrix[fixed, fixed] = 1.0
    return matrix, right_side
