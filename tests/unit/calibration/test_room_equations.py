"""Steps and covariances from the normal equations of rooms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.pattern import room_equations
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.tile_equations import Normal
from starling.calibration.pattern.unprojected import PatternImage

GRID = Grid(half_a=0.2, half_b=0.2, step=0.1)
FLAT = np.ones(GRID.shape, np.float32)
IMAGE = PatternImage(grid=GRID, value=FLAT, sd=FLAT, views=FLAT)


def _model(scales: dict[str, float]) -> Model:
    emitter = Emission(position_m=np.zeros(3), source=IMAGE)
    return Model(emitters=(emitter,), rotation_deg=(0.0, 0.0, 0.0), scales=scales)


def _normal(slopes: np.ndarray, residual: np.ndarray) -> Normal:
    """Of tiles (t, m, n) of residuals (t, m)."""
    scores = np.einsum("tmn,tm->tn", slopes, residual)
    return Normal(
        matrix=np.einsum("tmn,tmk->nk", slopes, slopes),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=0.0,
        freedom=residual.size,
        strengths=np.ones((len(scores), 1)),
    )


def _rooms(rng: np.random.Generator, model: Model, wrong: float) -> dict[str, Normal]:
    """Rooms of one scene each, whose references are wrong by a common share of every slope."""
    names, rooms = model.names, {}
    for scene in model.scales:
        slopes = rng.standard_normal((40, 30, len(names)))
        for other in model.scales:
            if other != scene:
                slopes[:, :, names.index(f"pattern_scale[{other}]")] = 0
        residual = rng.standard_normal((40, 30)) + slopes @ (
            wrong * rng.standard_normal(len(names))
        )
        rooms[scene] = _normal(slopes, residual)
    return rooms


def test_the_gauge_brings_the_scales_mean_back_to_one() -> None:
    """Steps of three scales, 2e-3 off in the mean, take it to 1."""
    model = _model({"a": 1.004, "b": 1.0, "c": 1.002})
    rooms = _rooms(np.random.default_rng(0), model, 0.0)
    step = room_equations.step(rooms, model, np.zeros(len(model.names), bool))
    scales = [model.names.index(f"pattern_scale[{one}]") for one in "abc"]
    assert step[scales].sum() == pytest.approx(-0.006, rel=0.02)


def test_what_is_held_stays_and_a_scene_left_out_moves_no_other() -> None:
    """Of a, b and c without c, the scales of a and b keep their sum: there is none to make up."""
    model = _model({"a": 0.998, "b": 1.001, "c": 1.001})
    rooms = _rooms(np.random.default_rng(1), model, 0.0)
    held = np.array([name == "pattern_scale[c]" for name in model.names])
    step = room_equations.step({k: rooms[k] for k in "ab"}, model, held)
    a, b, c = (step[model.names.index(f"pattern_scale[{one}]")] for one in "abc")
    assert c == 0 and a != 0 and a + b == pytest.approx(0, abs=1e-3 * abs(a - b))


def _solved(matrix: np.ndarray, right_side: np.ndarray) -> NDArray[np.float64]:
    return np.asarray(np.linalg.solve(matrix, right_side), np.float64)


def test_attenuated_steps_are_made_whole() -> None:
    """Equations whose matrix is too large along one direction, and right across it.

    Two steps show it; the third, lengthened, reaches the place. Nothing shorter than a fifth of the
    way is believed.
    """
    right, axis = np.diag([4.0, 1.0, 9.0]), np.array([0.6, 0.8, 0.0])
    noisy = right + 1.5 * np.outer(axis, axis) * (axis @ right @ axis)
    off = 2.5 * np.linalg.solve(right, axis)
    first = _solved(noisy, right @ off)
    second = _solved(noisy, right @ (off - first))
    whole = room_equations.lengthening(noisy, first, first, second)
    np.testing.assert_allclose(whole @ second, off - first, rtol=1e-9)
    across = np.array([0.8, -0.6, 0.5])  # Of no length together with a step, by that matrix.
    np.testing.assert_allclose(whole @ across, across, atol=1e-12)
    worst = room_equations.lengthening(noisy, first, first, first)
    np.testing.assert_allclose(worst @ first, 5 * first)
    nothing = room_equations.lengthening(noisy, np.zeros(3), np.zeros(3), first)
    np.testing.assert_array_equal(nothing, np.eye(3))


def test_two_rooms_say_nothing() -> None:
    assert not room_equations.jackknife([np.full(4, 9.0), np.zeros(4)]).any()
    assert not room_equations.jackknife([]).any()


def test_parts_that_differ_widen() -> None:
    """The jackknife's formula, with Student's factor, where it is the larger; else nothing."""
    moved = [np.array([0.0, 0.0]), np.array([3.0, 1e-3]), np.array([6.0, 2e-3])]
    found = room_equations.jackknife(moved)
    student = stats.t.ppf(0.95, 2) / stats.norm.ppf(0.95)
    np.testing.assert_allclose(found, student**2 * 2 / 3 * np.array([18, 2e-6]))
    wide = room_equations.widened_to(np.array([[1.0, 0.5], [0.5, 1.0]]), found)
    assert wide[0, 0] == pytest.approx(found[0]) and wide[1, 1] == 1
    assert wide[0, 1] == pytest.approx(0.5 * np.sqrt(found[0]))


def test_intervals_hold_where_rooms_are_wrong() -> None:
    """Nominal 90 % intervals of a place hold it in 80 to 97 % of 150 draws of five rooms.

    Each room's reference is wrong in its own way by 20 times what its noise allows; tiles alone
    would hold the truth in less than half of the draws. Errors that all rooms share are beyond
    this.
    """
    rng = np.random.default_rng(2)
    inside, alone = [], []
    model = _model(dict.fromkeys("abcde", 1.0))
    held = np.array([name.startswith(("pattern_scale", "right")) for name in model.names])
    for _ in range(150):
        rooms = _rooms(rng, model, 0.3)
        step = room_equations.step(rooms, model, held)[:3]
        tiles = room_equations.by_tile(rooms, model, held)
        by_room = room_equations.jackknife(room_equations.moves(rooms, model, held))
        wide = room_equations.widened_to(tiles, by_room)
        inside.append(np.abs(step) < 1.645 * np.sqrt(np.diagonal(wide)[:3]))
        alone.append(np.abs(step) < 1.645 * np.sqrt(np.diagonal(tiles)[:3]))
    assert 0.80 <= np.mean(inside) <= 0.97
    assert np.mean(alone) < 0.5
