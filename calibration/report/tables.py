"""The tables of a calibration's report, as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from starling.calibration.solution import Estimate, Solution
from starling.sim.report.elements import NONE, PLUS_MINUS, number, table

_LEAST_SHOWN = 0.005  # A correlation below is 0.00.
_STRONG = 0.9  # Of a correlation: what moves together to be named.
_MOST_PAIRS = 8


def estimates(rows: Sequence[Estimate]) -> str:
    """A table of fitted numbers, each with as many digits as its deviation bears."""
    head = ("Name", "Value", f"{PLUS_MINUS} sd", "Unit", "Start", "Moved by")
    return table(head, [_estimate(one) for one in rows])


def _estimate(one: Estimate) -> list[str]:
    name = f"<code>{escape(one.name)}</code>"
    known = math.isfinite(one.sd) and one.sd > 0
    digits = f".{_decimals(one.sd)}f" if known else ".6g"
    sd = number(one.sd, digits) if known else '<span class="loose">not determined</span>'
    if one.sd == 0:
        sd = "0"
    moved = f"{number((one.value - one.start) / one.sd, '+.1f')} sd" if known else NONE
    if not math.isfinite(one.start):
        moved = NONE
    return [
        name,
        number(one.value, digits),
        sd,
        escape("" if one.unit == "1" else one.unit),
        number(one.start, digits),
        moved,
    ]


def _decimals(sd: float) -> int:
    """Decimals that show two digits of a deviation."""
    return min(max(1 - math.floor(math.log10(sd)), 0), 12)


def correlations(solution: Solution) -> str:
    """The matrix of correlations, red where two numbers rise together, blue where one falls."""
    names = [one.name for one in solution.estimates]
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
    """Sentences on the pairs that move together most."""
    matrix = _correlation(solution)
    names = [f"<code>{escape(one.name)}</code>" for one in solution.estimates]
    pairs = sorted(
        ((abs(matrix[i, j]), i, j) for i in range(len(names)) for j in range(i)), reverse=True
    )
    shown = [
        f"{names[j]} and {names[i]}: {number(matrix[i, j], '+.3f')}"
        for size, i, j in pairs[:_MOST_PAIRS]
        if size >= _STRONG
    ]
    if not shown:
        return f"<p>No two numbers correlate by {_STRONG} or more.</p>"
    listed = "".join(f"<li>{text}</li>" for text in shown)
    return f"<p>Hardest to tell apart:</p><ul>{listed}</ul>"


def _correlation(solution: Solution) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # Of what is not determined, both are infinite.
        return solution.correlation


def _cell(names: Sequence[str], matrix: NDArray[np.float64], i: int, j: int) -> str:
    value = float(matrix[i, j])
    title = f"{names[i]}, {names[j]}: {value:.3f}"
    sign = "plus" if value > 0 else "minus"
    size = 0.0 if i == j else min(abs(value), 1.0)
    colour = f"background: rgba(var(--{sign}), {0.75 * size:.2f})"
    # What is not determined correlates with nothing, not even with itself.
    shown = number(value, ".2f") if abs(value) >= _LEAST_SHOWN else ""
    return f'<td style="{colour}" title="{escape(title)}">{"1" if i == j and shown else shown}</td>'


def scenes(values: dict[str, dict[str, float]]) -> str:
    """What differs by scene, a column for each name that any scene has."""
    names = list(dict.fromkeys(name for scene in values.values() for name in scene))
    rows = [
        [escape(scene), *(number(own.get(name, math.nan), ".6g") for name in names)]
        for scene, own in values.items()
    ]
    return table(["Scene", *names], rows)
