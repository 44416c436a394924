"""Steps and covariances from the normal equations of rooms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.pattern import room_equations
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.tile_equations import NormalEquations
from starling.calibration.pattern.unprojected import PatternImage

GRID = Grid(half_a=0.2, half_b=0.2, step=0.1)
FLAT = np.ones(GRID.shape, np.float32)
IMAGE = PatternImage(grid=GRID, value=FLAT, sd=FLAT, views=FLAT)


def _model(scales: dict[str, float]) -> EmitterModel:
    emitter = PatternEmitter(position_m=np.zeros(3), source=IMAGE)
    return EmitterModel(emitters=(emitter,), rotation_deg=(0.0, 0.0, 0.0), scales=scales)


def _normal(slopes: np.ndarray, residual: np.ndarray) -> NormalEquations:
    """Return the equations of tiles with derivatives (t, m, n) and residuals (t, m)."""
    scores = np.einsum("tmn,tm->tn", slopes, residual)
    return NormalEquations(
        matrix=np.einsum("tmn,tmk->nk", slopes, slopes),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=0.0,
        freedom=residual.size,
        strengths=np.ones((len(scores), 1)),
    )


def _rooms(
    rng: np.random.Generator, model: EmitterModel, wrong: float
) -> dict[str, NormalEquations]:
    """Return equations of rooms with one scene each and a reference error by room."""
    names, rooms = model.names, {}
    for scene in model.scales:
        slopes = rng.standard_normal((40, 30, len(names)))
        for other_scene in model.scales:
            if other_scene != scene:
                slopes[:, :, names.index(f"pattern_scale[{other_scene}]")] = 0
        residual = rng.standard_normal((40, 30)) + slopes @ (
            wrong * rng.standard_normal(len(names))
        )
        rooms[scene] = _normal(slopes, residual)
    return rooms


def test_the_gauge_brings_the_scales_mean_back_to_one() -> None:
    """The step of three scales corrects their mean by 2e-3 to 1."""
    model = _model({"a": 1.004, "b": 1.0, "c": 1.002})
    rooms = _rooms(np.random.default_rng(0), model, 0.0)
    step = room_equations.gauss_newton_step(rooms, model, np.zeros(len(model.names), bool))
    scales = [model.names.index(f"pattern_scale[{scene}]") for scene in "abc"]
    assert step[scales].sum() == pytest.approx(-0.006, rel=0.02)


def test_fixed_parameters_stay_and_the_gauge_excludes_them() -> None:
    """Without scene c, the sum of the scales of a and b does not change."""
    model = _model({"a": 0.998, "b": 1.001, "c": 1.001})
    rooms = _rooms(np.random.default_rng(1), model, 0.0)
    held = np.array([name == "pattern_scale[c]" for name in model.names])
    step = room_equations.gauss_newton_step({k: rooms[k] for k in "ab"}, model, held)
    a, b, c = (step[model.names.index(f"pattern_scale[{scene}]")] for scene in "abc")
    assert c == 0 and a != 0 and a + b == pytest.approx(0, abs=1e-3 * abs(a - b))


def _solved(matrix: np.ndarray, right_side: np.ndarray) -> NDArray[np.float64]:
    return np.asarray(np.linalg.solve(matrix, right_side), np.float64)


def test_attenuated_steps_are_corrected() -> None:
    """A matrix that is too large along one direction is corrected after two steps.

    The corrected third step reaches the solution. The attenuation is at least 0.2.
    """
    right, axis = np.diag([4.0, 1.0, 9.0]), np.array([0.6, 0.8, 0.0])
    noisy = right + 1.5 * np.outer(axis, axis) * (axis @ right @ axis)
    off = 2.5 * np.linalg.solve(right, axis)
    first = _solved(noisy, right @ off)
    second = _solved(noisy, right @ (off - first))
    whole = room_equations.step_correction(noisy, first, first, second)
    np.testing.assert_allclose(whole @ second, off - first, rtol=1e-9)
    across = np.array([0.8, -0.6, 0.5])  # Orthogonal to the step in the metric of the matrix.
    np.testing.assert_allclose(whole @ across, across, atol=1e-12)
    worst = room_equations.step_correction(noisy, first, first, first)
    np.testing.assert_allclose(worst @ first, 5 * first)
    nothing = room_equations.step_correction(noisy, np.zeros(3), np.zeros(3), first)
    np.testing.assert_array_equal(nothing, np.eye(3))


def test_two_rooms_give_no_jackknife_variance() -> None:
    assert not room_equations.jackknife([np.full(4, 9.0), np.zeros(4)]).any()
    assert not room_equations.jackknife([]).any()


def test_scatter_of_parts_increases_the_variance() -> None:
    """The jackknife variance with Student's factor replaces a smaller variance."""
    moved = [np.array([0.0, 0.0]), np.array([3.0, 1e-3]), np.array([6.0, 2e-3])]
    variance = room_equations.jackknife(moved)
    student = stats.t.ppf(0.95, 2) / stats.norm.ppf(0.95)
    np.testing.assert_allclose(variance, student**2 * 2 / 3 * np.array([18, 2e-6]))
    wide = room_equations.with_variances(np.array([[1.0, 0.5], [0.5, 1.0]]), variance)
    assert wide[0, 0] == pytest.approx(variance[0]) and wide[1, 1] == 1
    assert wide[0, 1] == pytest.approx(0.5 * np.sqrt(variance[0]))


def test_intervals_cover_reference_errors_by_room() -> None:
    """Nominal 90 % intervals cover a position in 80 to 97 % of 150 draws of five rooms.

    Each room has a reference error of 20 times its noise. Intervals from tiles only would cover
    the truth in less than half of the draws. Errors common to all rooms are not covered.
    """
    rng = np.random.default_rng(2)
    inside, alone = [], []
    model = _model(dict.fromkeys("abcde", 1.0))
    held = np.array([name.startswith(("pattern_scale", "right")) for name in model.names])
    for _ in range(150):
        rooms = _rooms(rng, model, 0.3)
        step = room_equations.gauss_newton_step(rooms, model, held)[:3]
        tiles = room_equations.tile_covariance(rooms, model, held)
        by_room = room_equations.jackknife(room_equations.leave_one_out_steps(rooms, model, held))
        wide = room_equations.with_variances(tiles, by_room)
        inside.append(np.abs(step) < 1.645 * np.sqrt(np.diagonal(wide)[:3]))
        alone.append(np.abs(step) < 1.645 * np.sqrt(np.diagonal(tiles)[:3]))
    assert 0.80 <= np.mean(inside) <= 0.97
    assert np.mean(alone) < 0.5
