"""Tables of a calibration's report, as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from starling.calibration.solution import Estimate, Solution
from starling.sim.report.elements import NONE, PLUS_MINUS, number, table

_LEAST_SHOWN = 0.005  # Smaller correlations round to 0.00.
_STRONG = 0.9  # Minimum correlation of a pair that is listed.
_MOST_PAIRS = 8  # Maximum number of listed pairs.


def estimates(rows: Sequence[Estimate]) -> str:
    """Return a table of parameters; the standard deviation sets the number of digits."""
    head = ("Name", "Value", f"{PLUS_MINUS} std", "Unit", "Start", "Change")
    return table(head, [_estimate(estimate) for estimate in rows])


def _estimate(estimate: Estimate) -> list[str]:
    name = f"<code>{escape(estimate.name)}</code>"
    known = math.isfinite(estimate.sd) and estimate.sd > 0
    digits = f".{_decimals(estimate.sd)}f" if known else ".6g"
    sd = number(estimate.sd, digits) if known else '<span class="loose">unidentifiable</span>'
    if estimate.sd == 0:
        sd = "0"
    change = (
        f"{number((estimate.value - estimate.start) / estimate.sd, '+.1f')} std" if known else NONE
    )
    if not math.isfinite(estimate.start):
        change = NONE
    return [
        name,
        number(estimate.value, digits),
        sd,
        escape("" if estimate.unit == "1" else estimate.unit),
        number(estimate.start, digits),
        change,
    ]


def _decimals(sd: float) -> int:
    """Return the decimals that show two significant digits of a standard deviation."""
    return min(max(1 - math.floor(math.log10(sd)), 0), 12)


def correlations(solution: Solution) -> str:
    """Return the correlation matrix; red cells are positive, blue cells negative."""
    names = [estimate.name for estimate in solution.estimates]
    matrix = _correlation(solution)
    heads = "".join(
        f'<th scope="col" title="{escape(name)}">{i}</th>' for i, name in enumerate(names, 1)
    )
    rows = []
    for i, name in enumerate(names):
        cells = "".join(_cell(names, matrix, i, j) for j in range(len(names)))
        rows.append(f'<tr><th scope="row">{i + 1} <code>{escape(name)}</code></th>{cells}</tr>')
    return (
        f'<div class="scroll"><table class="matrix"><thead><tr><td></td>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def strongest(solution: Solution) -> str:
    """List the most strongly correlated pairs of parameters."""
    matrix = _correlation(solution)
    names = [f"<code>{escape(estimate.name)}</code>" for estimate in solution.estimates]
    pairs = sorted(
        ((abs(matrix[i, j]), i, j) for i in range(len(names)) for j in range(i)), reverse=True
    )
    shown = [
        f"{names[j]} and {names[i]}: {number(matrix[i, j], '+.3f')}"
        for size, i, j in pairs[:_MOST_PAIRS]
        if size >= _STRONG
    ]
    if not shown:
        return f"<p>No two parameters correlate by {_STRONG} or more.</p>"
    items = "".join(f"<li>{text}</li>" for text in shown)
    return f"<p>Most strongly correlated:</p><ul>{items}</ul>"


def _correlation(solution: Solution) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # Infinite variances give inf / inf.
        return solution.correlation


def _cell(names: Sequence[str], matrix: NDArray[np.float64], i: int, j: int) -> str:
    value = float(matrix[i, j])
    title = f"{names[i]}, {names[j]}: {value:.3f}"
    sign = "plus" if value > 0 else "minus"
    size = 0.0 if i == j else min(abs(value), 1.0)
    colour = f"background: rgba(var(--{sign}), {0.75 * size:.2f})"
    # An unidentifiable parameter has no correlation, not even on the diagonal.
    shown = number(value, ".2f") if abs(value) >= _LEAST_SHOWN else ""
    return f'<td style="{colour}" title="{escape(title)}">{"1" if i == j and shown else shown}</td>'


def scenes(values: dict[str, dict[str, float]]) -> str:
    """Return a table of values by scene, with a column for each name that any scene has."""
    names = list(dict.fromkeys(name for scene in values.values() for name in scene))
    rows = [
        [escape(scene), *(number(scene_values.get(name, math.nan), ".6g") for name in names)]
        for scene, scene_values in values.items()
    ]
    return table(["Scene", *names], rows)
