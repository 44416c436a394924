"""Levenberg-Marquardt on residuals of a few numbers, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.least_squares import solve, uncertainty
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.calibration.parameters import Parameter


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
    """Of residuals (clusters, m) and their slopes (clusters, m, p)."""
    scores = np.einsum("cmp,cm->cp", slope, residual)
    shares = np.einsum("cmp,cmq->cpq", slope, slope)
    return Toy(shares.sum(axis=0), scores.sum(axis=0), float((residual**2).sum()), scores, shares)


def test_a_curved_valley_is_followed_to_its_end() -> None:
    """Rosenbrock's function, ten to one across its valley, from the usual start."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        x, y = step
        residual = 1e4 * np.array([[3 * (y - x * x), 1 - x]])
        slope = 1e4 * np.array([[[-6 * x, 3], [-1, 0]]])
        return toy(residual, slope)

    found = solve.solve(evaluate, evaluate, np.array([-1.2, 1.0]), inflation=1.0)
    np.testing.assert_allclose(found.step, 1, atol=1e-3)
    assert found.costs[-1] == 1


def test_a_step_that_makes_it_worse_is_shortened() -> None:
    """Far out an arctangent is flat: an undamped step overshoots further each time."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        residual = 1e3 * np.arctan(step)[None]
        return toy(residual, 1e3 * (1 / (1 + step**2))[None, None])

    found = solve.solve(evaluate, evaluate, np.array([4.0]), inflation=1.0)
    assert abs(found.step[0]) < 1e-2


def test_what_nothing_determines_stays_within_its_tolerance() -> None:
    """A parameter that moves no residual is drawn to where the fit begins."""

    def evaluate(step: np.ndarray, like: Toy | None) -> Toy:
        del like
        residual = np.stack([100 * (step[:1] - 0.5)])
        return toy(residual, np.array([[[100.0, 0.0]]]))

    found = solve.solve(evaluate, evaluate, np.array([0.0, 0.8]), inflation=1.0)
    np.testing.assert_allclose(found.step, [0.5, 0.0], atol=1e-3)


def test_nominal_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """90 % intervals of a linear fit whose residuals go together in clusters of uneven weight.

    Ordinary intervals, which take residuals as independent, hold it far less often. It proves
    nothing of a curved problem, nor of correlation beyond the clusters.
    """
    rng = np.random.default_rng(0)
    clusters, size, count, repeats = 60, 30, 4, 400
    slope = 3 * rng.standard_normal((clusters, size, count)) * rng.gamma(2, 1, (clusters, 1, 1))
    slope += 2 * slope.mean(axis=1, keepdims=True) * np.sqrt(size)
    inside = ordinary = 0
    for _ in range(repeats):
        noise = rng.standard_normal((clusters, size)) + rng.standard_normal((clusters, 1))
        equations = toy(noise, slope)
        found = uncertainty.of(equations)
        bread = np.linalg.inv(equations.information + np.eye(count))
        step = -bread @ equations.gradient
        inside += (np.abs(step) < 1.645 * np.sqrt(np.diagonal(found.covariance))).sum()
        ordinary += (np.abs(step) < 1.645 * np.sqrt(np.diagonal(bread))).sum()
    assert 0.86 < inside / (repeats * count) < 0.95
    assert ordinary / (repeats * count) < 0.6


ROWS = tuple(
    Parameter(name=name, group="", unit="", tolerance=1.0)
    for name in ("fx_px", "baseline_m", "projector.position_m.z", "projector.rotation_deg.y")
)


def of_directions(*directions: tuple[float, ...]) -> Uncertainty:
    """Uncertainty of residuals that tell these combinations of the rows, and no other."""
    slope = 1e3 * np.array([directions])
    return uncertainty.of(toy(np.zeros((1, len(directions))), slope))


def test_directions_that_are_open_are_named() -> None:
    found = of_directions((1, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    assert list(found.open) == [True, True, False, False]
    (sentence,) = uncertainty.sentences(found, ROWS)
    assert sentence.startswith(("fx_px and baseline_m cannot", "baseline_m and fx_px cannot"))
    assert "several distances" in sentence


def test_a_parameter_that_is_open_alone_is_named_alone() -> None:
    found = of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1))
    (sentence,) = uncertainty.sentences(found, ROWS)
    assert sentence.startswith("projector.position_m.z is not determined by these captures: ")
    assert "second distance" in sentence


def test_what_is_determined_is_not_named() -> None:
    found = of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    assert not found.open.any() and uncertainty.sentences(found, ROWS) == ()


def test_the_remedy_for_blur_is_light() -> None:
    blur = Parameter(name=parameters.DOT_BLUR, group="", unit="", tolerance=1.0)
    found = uncertainty.of(toy(np.zeros((1, 1)), np.zeros((1, 1, 1))))
    (sentence,) = uncertainty.sentences(found, (blur,))
    assert "more light" in sentence


def test_the_scale_of_reference_depth_is_named_whatever_residuals_say() -> None:
    every = of_directions((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    found = uncertainty.scale_open(every, ROWS)
    assert list(found.open) == [True, True, False, False]
    (sentence,) = uncertainty.sentences(found, ROWS)
    assert "fx_px" in sentence and "baseline_m" in sentence
    assert uncertainty.scale_open(found, ROWS) is found


@pytest.mark.parametrize("stiffness", [1.0, 0.5])
def test_a_cluster_that_weighs_most_is_not_surer_for_it(stiffness: float) -> None:
    """Each score is larger by its leverage h: var = sum s^2 / (1 - h) / M^2 + 1 / M^2.

    The cost's curvature M is less than its weights say, and the fit the less sure.
    """
    share, score = np.array([8.0, 0.6, 0.4]), np.array([3.0, -1.0, 2.0])
    found = uncertainty.of(
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
    assert found.covariance[0, 0] == pytest.approx(expected)
