"""Levenberg-Marquardt on small problems, and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.least_squares import solve, uncertainty
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.calibration.parameters import CalibrationParameter


@dataclass
class Toy:
    """Normal equations of residuals in clusters."""

    information: np.ndarray
    gradient: np.ndarray
    cost: float
    scores: np.ndarray
    shares: np.ndarray
    deviation: float = 1.0
    freedom: int = 100
    stiffness: float = 1.0


def toy(residual: np.ndarray, slope: np.ndarray) -> Toy:
    """Build equations from residuals (clusters, m) and their derivatives (clusters, m, p)."""
    scores = np.einsum("cmp,cm->cp", slope, residual)
    shares = np.einsum("cmp,cmq->cpq", slope, slope)
    return Toy(shares.sum(axis=0), scores.sum(axis=0), float((residual**2).sum()), scores, shares)


def test_a_curved_valley_is_minimised() -> None:
    """The fit minimises a scaled Rosenbrock function from the usual initial point."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        x, y = step
        residual = 1e4 * np.array([[3 * (y - x * x), 1 - x]])
        slope = 1e4 * np.array([[[-6 * x, 3], [-1, 0]]])
        return toy(residual, slope)

    result = solve.solve(evaluate, evaluate, np.array([-1.2, 1.0]), inflation=1.0)
    np.testing.assert_allclose(result.step, 1, atol=1e-3)
    assert result.costs[-1] == 1


def test_a_step_that_raises_the_cost_is_damped() -> None:
    """Undamped Gauss-Newton steps on an arctangent diverge."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        residual = 1e3 * np.arctan(step)[None]
        return toy(residual, 1e3 * (1 / (1 + step**2))[None, None])

    result = solve.solve(evaluate, evaluate, np.array([4.0]), inflation=1.0)
    assert abs(result.step[0]) < 1e-2


def test_undetermined_parameters_stay_near_the_prior() -> None:
    """The prior pulls a parameter without effect on residuals to its initial value."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        residual = np.stack([100 * (step[:1] - 0.5)])
        return toy(residual, np.array([[[100.0, 0.0]]]))

    result = solve.solve(evaluate, evaluate, np.array([0.0, 0.8]), inflation=1.0)
    np.testing.assert_allclose(result.step, [0.5, 0.0], atol=1e-3)


def test_nominal_intervals_have_their_coverage() -> None:
    """90 % intervals of a linear fit cover the truth, with residuals correlated in clusters.

    Intervals for independent residuals cover it far less often. The test does not cover nonlinear
    problems or correlation between clusters.
    """
    rng = np.random.default_rng(0)
    clusters, size, count, repeats = 60, 30, 4, 400
    slope = 3 * rng.standard_normal((clusters, size, count)) * rng.gamma(2, 1, (clusters, 1, 1))
    slope += 2 * slope.mean(axis=1, keepdims=True) * np.sqrt(size)
    inside = ordinary = 0
    for _ in range(repeats):
        noise = rng.standard_normal((clusters, size)) + rng.standard_normal((clusters, 1))
        equations = toy(noise, slope)
        result = uncertainty.estimate(equations)
        bread = np.linalg.inv(equations.information + np.eye(count))
        step = -bread @ equations.gradient
        inside += (np.abs(step) < 1.645 * np.sqrt(np.diagonal(result.covariance))).sum()
        ordinary += (np.abs(step) < 1.645 * np.sqrt(np.diagonal(bread))).sum()
    assert 0.86 < inside / (repeats * count) < 0.95
    assert ordinary / (repeats * count) < 0.6


ROWS = tuple(
    CalibrationParameter(name=name, group="", unit="", tolerance=1.0)
    for name in ("fx_px", "baseline_m", "projector.position_m.z", "projector.rotation_deg.y")
)


def uncertainty_of_directions(*directions: tuple[float, ...]) -> Uncertainty:
    """Return the uncertainty if residuals determine only the given combinations of parameters."""
    slope = 1e3 * np.array([directions])
    return uncertainty.estimate(toy(np.zeros((1, len(directions))), slope))


def test_undetermined_directions_are_reported() -> None:
    result = uncertainty_of_directions((1, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    assert list(result.open) == [True, True, False, False]
    (sentence,) = uncertainty.sentences(result, ROWS)
    assert sentence.startswith(("fx_px and baseline_m cannot", "baseline_m and fx_px cannot"))
    assert "several distances" in sentence


def test_a_single_undetermined_parameter_is_reported() -> None:
    result = uncertainty_of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1))
    (sentence,) = uncertainty.sentences(result, ROWS)
    assert sentence.startswith("projector.position_m.z is not determined by these captures: ")
    assert "second distance" in sentence


def test_determined_parameters_are_not_reported() -> None:
    result = uncertainty_of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    assert not result.open.any() and uncertainty.sentences(result, ROWS) == ()


def test_the_remedy_for_blur_is_light() -> None:
    blur = CalibrationParameter(name=parameters.DOT_BLUR, group="", unit="", tolerance=1.0)
    result = uncertainty.estimate(toy(np.zeros((1, 1)), np.zeros((1, 1, 1))))
    (sentence,) = uncertainty.sentences(result, (blur,))
    assert "more light" in sentence


def test_the_scale_of_reference_depth_is_always_open() -> None:
    determined = uncertainty_of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    result = uncertainty.with_open_scale(determined, ROWS)
    assert list(result.open) == [True, True, False, False]
    (sentence,) = uncertainty.sentences(result, ROWS)
    assert "fx_px" in sentence and "baseline_m" in sentence
    assert uncertainty.with_open_scale(result, ROWS) is result


@pytest.mark.parametrize("stiffness", [1.0, 0.5])
def test_leverage_increases_the_variance(stiffness: float) -> None:
    """Leverage h scales the scores: var = sum s^2 / (1 - h) / M^2 + 1 / M^2.

    The curvature M of the robust cost is below its weights, which increases the variance.
    """
    share, score = np.array([8.0, 0.6, 0.4]), np.array([3.0, -1.0, 2.0])
    result = uncertainty.estimate(
        Toy(
            share.sum(keepdims=True)[None],
            np.zeros(1),
            1.0,
            score[:, None],
            share[:, None, None],
            stiffness=stiffness,
        )
    )
    whole = stiffness * share.sum() + 1  # The tolerance counts too.
    expected = ((score**2 / (1 - stiffness * share / whole)).sum() + 1) / whole**2
    assert result.covariance[0, 0] == pytest.approx(expected)
