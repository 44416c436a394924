"""Levenberg-Marquardt over few parameters, in stages from coarse to fine.

Steps are in units of the parameters' tolerances, and so is the one thing that is believed before
any capture: that a unit is within its tolerances of where the fit begins. It weighs nothing against
what the captures determine, and holds the rest in place.

Sources: Marquardt, SIAM J. 11(2), 1963; robust weights by iteration: Holland and Welsch,
Comm. Stat. A6(9), 1977.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_DAMPING = 1e-5  # The least, of the information's diagonal, where an undamped step fails.
_WORST = 1e4  # Damping beyond which no step helps.
_MOST_STEPS = 10  # In each stage.
_DONE = 0.05  # Squared step in its standard deviations below which no other is tried.
_COARSE_DONE = 3.0  # Likewise where a finer stage follows.
# Rise of the mean cost, of itself, that is no worse: with a step a few pixels come and go.
_NOTHING = 1e-3


class Equations(Protocol):
    """Normal equations at one place."""

    @property
    def information(self) -> NDArray[np.float64]:
        """(p, p) of the parameters in tolerances."""
        ...

    @property
    def gradient(self) -> Vector:
        """(p,) of half the cost."""
        ...

    @property
    def cost(self) -> float:
        """Robust sum of squared residuals over their deviations."""
        ...

    @property
    def deviation(self) -> float:
        """Mean variance that residuals were weighed with."""
        ...

    @property
    def freedom(self) -> int:
        """Residuals less what was fitted to them beside the parameters."""
        ...


E = TypeVar("E", bound=Equations)
# Equations after a step, weighed as given ones were; None weighs anew.
Evaluate = Callable[[Vector, E | None], E]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solved(Generic[E]):
    """Where the steps ended."""

    step: Vector  # (p,) from where the fit begins, in tolerances.
    equations: E
    costs: tuple[float, ...]  # Mean squared residual of the last stage, 1 at its end.


def solve(coarse: Evaluate[E], fine: Evaluate[E], step: Vector, *, inflation: float) -> Solved[E]:
    """Minimise the robust cost and the squared step together, first roughly on coarse residuals.

    Args:
        coarse: equations of images blurred alike.
        fine: equations of the images as they are.
        step: (p,) to begin with, in tolerances.
        inflation: variance of sums of coarse residuals over what it were if they were
            independent: smoothed images seem surer than they are.
    """
    step, _, _ = _descended(coarse, step, done=_COARSE_DONE * inflation)
    step, equations, costs = _descended(fine, step, done=_DONE)
    return Solved(step=step, equations=equations, costs=tuple(cost / costs[-1] for cost in costs))


def _descended(
    evaluate: Evaluate[E], step: Vector, *, done: float
) -> tuple[Vector, E, list[float]]:
    """Step until it is short: where to, the equations there, and the mean cost on the way."""
    equations = evaluate(step, None)
    costs = [_mean(equations)]
    damping = 0.0
    for _ in range(_MOST_STEPS):
        trial, length, damping = _tried(evaluate, equations, step, damping, done)
        if trial is None:
            break
        step = trial
        if length < done:  # The equations are still right.
            break
        equations = evaluate(step, None)
        costs.append(_mean(equations))
    return step, equations, costs


def _mean(equations: Equations) -> float:
    return equations.cost / equations.freedom * equations.deviation


def _tried(
    evaluate: Evaluate[E],
    equations: E,
    step: Vector,
    damping: float,
    done: float,
) -> tuple[Vector | None, float, float]:
    """One step that lowers the cost, the squared way left in deviations, and the damping after.

    A step too short to matter is not looked at again.
    """
    information = equations.information + np.eye(len(step))
    cost = (equations.cost + float(step @ step)) / equations.freedom
    downhill = -(equations.gradient + step)
    # Damping shortens steps most where least is known, so that a damped one says nothing of the
    # way that is left.
    whole = np.linalg.solve(information, downhill)
    length = float(whole @ information @ whole)
    if length < done:
        return step + whole, length, damping
    scale = np.diag(np.diagonal(information))
    while damping < _WORST:
        trial = step + np.linalg.solve(information + damping * scale, downhill)
        there = evaluate(trial, equations)
        mean = there.cost / there.freedom + float(trial @ trial) / equations.freedom
        if mean < (1 + _NOTHING) * cost:
            return trial, length, damping / 10 if damping > _DAMPING else 0.0
        damping = max(10 * damping, _DAMPING)
    return None, length, damping
