"""Normal equations of each room: where they say a model lies, and how sure they are of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.pattern import emitter_model, tile_equations
from starling.calibration.pattern.emitter_model import Model
from starling.calibration.pattern.tile_equations import Normal

LEAST_ROOMS = 3  # Fewer say nothing of how rooms differ.
_QUANTILE = 0.95  # At which Student's and the normal distribution are made alike.

_LEAST_SHARE = 0.2  # Of the way that a step goes; less cannot be told from none.

Rooms = Mapping[str, Normal]
Held = NDArray[np.bool_]  # (n,) of `Model.names`: what is not freed.
Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


def step(rooms: Rooms, model: Model, held: Held) -> Vector:
    """Gauss-Newton step (n,); what no view tells stays where it is."""
    normal = tile_equations.total(list(rooms.values()))
    gauge = _gauge(normal, model, held)
    matrix, right_side = _solvable(normal.matrix + gauge, normal.right_side, held)
    off = sum(model.scales.values()) - len(model.scales)
    return np.linalg.inv(matrix) @ (right_side - off * gauge.max(axis=1))


def by_tile(rooms: Rooms, model: Model, held: Held) -> Matrix:
    """Covariance (n, n) that holds where residuals within a tile go together (a sandwich).

    Source: White, Econometrica 50, 1982; Liang and Zeger, Biometrika 73, 1986.
    """
    normal = tile_equations.total(list(rooms.values()))
    matrix, _ = _solvable(normal.matrix + _gauge(normal, model, held), normal.right_side, held)
    inverse = np.linalg.inv(matrix)
    scores = np.where(held, 0.0, normal.scores)
    return inverse @ (scores.T @ scores) @ inverse


def moves(rooms: Rooms, model: Model, held: Held) -> list[Vector]:
    """One step towards the fit without each room, by the other rooms' equations at one place."""
    normal = tile_equations.total(list(rooms.values()))
    gauge = _gauge(normal, model, held)
    out = []
    for part in rooms.values():
        rest = np.diagonal(normal.matrix - part.matrix)
        alone = (np.diagonal(part.matrix) > 0) & (rest <= 0)  # What only this room tells of.
        left, side = _solvable(
            normal.matrix - part.matrix + gauge, normal.right_side - part.right_side, held | alone
        )
        out.append(np.linalg.solve(left, side))
    return out


def jackknife(moved: Sequence[Vector]) -> Vector:
    """Variances (n,) from what leaving out each of some parts moves; 0 from less than three parts.

    Few parts say little of how parts differ: Student's intervals are the wider for it.

    Args:
        moved: (n,) where a fit without each part lies.

    Source: Efron, The Jackknife, the Bootstrap and Other Resampling Plans (1982), ch. 3.
    """
    count = len(moved)
    if count < LEAST_ROOMS:
        return np.zeros(len(moved[0]) if moved else 1)
    spread = np.array(moved) - np.mean(moved, axis=0)
    student = stats.t.ppf(_QUANTILE, count - 1) / stats.norm.ppf(_QUANTILE)
    return np.asarray(student**2 * (count - 1) / count * (spread**2).sum(axis=0), np.float64)


def widened_to(covariance: Matrix, variance: Vector) -> Matrix:
    """Give a covariance (n, n) larger variances (n,), its correlations kept."""
    larger = np.sqrt(np.maximum(variance / np.diagonal(covariance).clip(1e-300), 1.0))
    return covariance * np.outer(larger, larger)


def lengthening(matrix: Matrix, applied: Vector, before: Vector, after: Vector) -> Matrix:
    """What makes steps (n,) whole that fall short along the last one: multiply them by it.

    Noise in a derivative adds to the normal equations' matrix and to nothing else: where little is
    known, along a valley, steps are a share of the way, and deviations a share of the spread. The
    share shows in what a step along there left of the next.

    Args:
        matrix: (n, n) of the normal equations, as a measure of length.
        applied: (n,) the last step as it was taken.
        before: (n,) the last step as the equations gave it.
        after: (n,) the next one as they give it.

    Source: Broyden, Mathematics of Computation 19, 1965 (a rank-one correction by a secant);
    Fuller, Measurement Error Models (1987), ch. 1 (attenuation).
    """
    along = matrix @ applied
    length = float(applied @ along)
    if length <= 0:
        return np.eye(len(applied))
    share = float(np.clip((before - after) @ along / length, _LEAST_SHARE, 1.0))
    return np.eye(len(applied)) + (1 / share - 1) * np.outer(applied, along) / length


def _gauge(normal: Normal, model: Model, held: Held) -> Matrix:
    """Weight (n, n) that holds the scenes' mean scale at 1: the pattern's own trades with it.

    Where the pattern is held, so is its scale.
    """
    scales = np.array([bool(emitter_model.scene_of(name)) for name in model.names])
    if (held & ~scales).any():
        return np.zeros_like(normal.matrix)
    among = (scales & ~held).astype(np.float64)
    stiff = 1e3 * np.diagonal(normal.matrix)[among > 0].max(initial=1.0)
    return stiff * np.outer(among, among)


def _solvable(matrix: Matrix, right_side: Vector, held: Held) -> tuple[Matrix, Vector]:
    """Leave where it is what is held, and what no view tells."""
    silent = held | (np.diagonal(matrix) == 0)
    matrix, right_side = matrix.copy(), np.where(silent, 0.0, right_side)
    matrix[silent], matrix[:, silent] = 0.0, 0.0
    matrix[silent, silent] = 1.0
    return matrix, right_side
