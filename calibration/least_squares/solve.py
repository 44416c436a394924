"""Levenberg-Marquardt for few parameters, with a coarse and a fine stage.

Steps are in units of the parameters' tolerances. The prior is standard normal in these units,
about the initial value. It is negligible for parameters that the captures determine, and keeps
the others near their initial value.

Sources: Marquardt, SIAM J. 11(2), 1963; robust weights by iteration: Holland and Welsch,
Comm. Stat. A6(9), 1977.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]

_DAMPING = 1e-5  # First damping after a failed step, relative to the information's diagonal.
_WORST = 1e4  # Maximum damping.
_MOST_STEPS = 10  # Maximum steps of a stage.
_DONE = 0.05  # Squared step below which a stage ends [squared standard deviations].
_COARSE_DONE = 3.0  # The same for the coarse stage.
# Permitted relative rise of the mean cost, because a step changes which pixels are used.
_NOTHING = 1e-3


class Equations(Protocol):
    """Normal equations at one step of p parameters in tolerances, without the prior."""

    @property
    def information(self) -> Matrix: ...  # (p, p)

    @property
    def gradient(self) -> Vector: ...  # (p,) of half the cost.

    @property
    def scores(self) -> Matrix: ...  # (clusters, p) gradient by cluster.

    @property
    def shares(self) -> Matrix: ...  # (clusters, p, p) information by cluster.

    @property
    def stiffness(self) -> float: ...  # Curvature of the cost over the information.

    @property
    def cost(self) -> float: ...  # Robust sum of squared residuals over their deviations.

    @property
    def deviation(self) -> float: ...  # Mean variance of the residuals' weights.

    @property
    def freedom(self) -> int: ...  # Residuals minus eliminated coefficients.


E = TypeVar("E", bound=Equations)
# Returns the equations after a step. It uses the weights of the second argument, or new weights
# if that is None.
Evaluate = Callable[[Vector, E | None], E]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SolveResult(Generic[E]):
    """Result of the steps."""

    step: Vector  # (p,) total step from the initial parameters, in tolerances.
    equations: E
    costs: tuple[float, ...]  # Mean squared residual in the last stage, over its final value.


def solve(
    coarse: Evaluate[E], fine: Evaluate[E], step: Vector, *, inflation: float
) -> SolveResult[E]:
    """Minimise robust cost plus squared step, first on coarse and then on fine residuals.

    Args:
        coarse: equations of blurred images.
        fine: equations of the original images.
        step: (p,) initial step, in tolerances.
        inflation: variance of sums of coarse residuals over that of independent residuals. It
            corrects for the correlation that blur adds.
    """
    step, _, _ = _descend(coarse, step, done=_COARSE_DONE * inflation)
    step, equations, costs = _descend(fine, step, done=_DONE)
    return SolveResult(
        step=step, equations=equations, costs=tuple(cost / costs[-1] for cost in costs)
    )


def _descend(evaluate: Evaluate[E], step: Vector, *, done: float) -> tuple[Vector, E, list[float]]:
    """Step until steps are short; return the last step, its equations and the mean costs."""
    equations = evaluate(step, None)
    costs = [_mean(equations)]
    damping = 0.0
    for _ in range(_MOST_STEPS):
        trial, length, damping = _try_step(evaluate, equations, step, damping, done)
        if trial is None:
            break
        step = trial
        if length < done:  # The step is too short to change the equations.
            break
        equations = evaluate(step, None)
        costs.append(_mean(equations))
    return step, equations, costs


def _mean(equations: Equations) -> float:
    return equations.cost / equations.freedom * equations.deviation


def _try_step(
    evaluate: Evaluate[E],
    equations: E,
    step: Vector,
    damping: float,
    done: float,
) -> tuple[Vector | None, float, float]:
    """Take one step that lowers the cost.

    Returns the step, the squared length of the undamped step in standard deviations, and the new
    damping. A step shorter than `done` is accepted without evaluation.
    """
    information = equations.information + np.eye(len(step))
    cost = (equations.cost + float(step @ step)) / equations.freedom
    downhill = -(equations.gradient + step)
    # Convergence is judged on the undamped step, because damping shortens poorly determined steps.
    full_step = np.linalg.solve(information, downhill)
    length = float(full_step @ information @ full_step)
    if length < done:
        return step + full_step, length, damping
    scale = np.diag(np.diagonal(information))
    while damping < _WORST:
        trial = step + np.linalg.solve(information + damping * scale, downhill)
        trial_equations = evaluate(trial, equations)
        mean = (
            trial_equations.cost / trial_equations.freedom
            + float(trial @ trial) / equations.freedom
        )
        if mean < (1 + _NOTHING) * cost:
            return trial, length, damping / 10 if damping > _DAMPING else 0.0
        damping = max(10 * damping, _DAMPING)
    return None, length, damping
