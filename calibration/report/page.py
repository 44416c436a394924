"""A calibration's report as one self-contained HTML page: `report.html`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.calibration.fit_sensor import Calibration
from starling.calibration.report import figures, heldout_section, pattern_section
from starling.calibration.solution import Estimate, Solution
from starling.sim.report import elements
from starling.sim.report.elements import (
    NONE,
    PLUS_MINUS,
    TIMES,
    counted,
    listed,
    number,
    sentences,
    table,
)

_LEAST_SHOWN = 0.005  # Smaller correlations round to 0.00.
_STRONG = 0.9  # Minimum correlation of a pair that is listed.
_MOST_PAIRS = 8  # Maximum number of listed pairs.


def page(calibration: Calibration) -> str:
    """Return a calibration as an HTML page with inline style, embedded pictures and no scripts.

    The figures come from `starling.calibration.report.figures`. Pictures show the held-out scenes
    with the best, the median and the worst score.
    """
    values = figures.calibration_figures(calibration)
    heldout = heldout_section.section(calibration, values["heldout"])
    pattern = pattern_section.section(calibration.recovered) if calibration.recovered else ""
    sections = {
        "parameters": ("Fitted parameters", _parameters(calibration)),
        "open": ("Unidentifiable parameters and warnings", _open(calibration)),
        "heldout": ("Held-out scenes", heldout),
        "pattern": ("Recovered pattern", pattern),
        "correlation": ("Correlation of the parameters", _correlation(calibration.solutions)),
        "fit": ("Convergence", _fit(calibration, values)),
    }
    title = f"Calibration of {calibration.sensor.name}"
    return elements.page(
        title,
        f"<h1>{escape(title)}</h1>{_summary(calibration, values)}",
        {key: section for key, section in sections.items() if section[1]},
    )


def _summary(calibration: Calibration, values: dict[str, Any]) -> str:
    sensor, held = calibration.sensor, values["heldout"]
    rooms = listed(calibration.fitted_rooms)
    groups = listed(calibration.solutions)
    text = (
        f"The sensor model <b>{escape(sensor.name)}</b> ({sensor.width} {TIMES} {sensor.height} "
        f"px) was fitted to captures of known surfaces. "
        f"Fitted: {groups}. Captures: {counted(len(calibration.fitted_rooms), 'room')}, {rooms}. "
        "Each parameter has a standard deviation (std). Scores come from scenes in held-out rooms, "
        "which the fit did not use."
    )
    loose = sum(not math.isfinite(parameter["sd"]) for parameter in values["parameters"].values())
    facts = [
        (
            "Held-out correlation",
            number(held["ncc"], ".3f"),
            f"upper bound {number(held['ceiling'], '.3f')}; before {_before(held, 'ncc')}",
        ),
        (
            "Lower quartile",
            number(held["ncc_p25"], ".3f"),
            f"upper bound {number(held['ceiling_p25'], '.3f')}; before {_before(held, 'ncc_p25')}",
        ),
        ("Parameters", str(len(values["parameters"])), f"{loose} of them unidentifiable"),
        ("Unidentifiable", str(len(values["undetermined"])), "parameters or combinations"),
        ("Warnings", str(len(values["warnings"])), "about the captures"),
        ("Time", _time(values["seconds"]), f"{counted(len(values['stages']), 'stage')}"),
    ]
    cells = "".join(
        f"<div><dt>{name}</dt><dd>{value}<small>{note}</small></dd></div>"
        for name, value, note in facts
    )
    return f'<p>{text}</p><dl class="facts">{cells}</dl>'


def _parameters(calibration: Calibration) -> str:
    blocks = [
        '<p class="quiet">A name is a path in the sensor file; <code>projector.field</code> is '
        "the tangent of half the projector's horizontal field of view. Positions are in the frame "
        "of the left imager: x right, y down, z forward.</p>"
    ]
    for name, solution in calibration.solutions.items():
        common = [
            estimate
            for estimate in solution.estimates
            if not figures.scene_parameter(estimate.name)[1]
        ]
        scene_estimates = [
            estimate for estimate in solution.estimates if figures.scene_parameter(estimate.name)[1]
        ]
        blocks.append(f"<h3>{escape(name.capitalize())}</h3>")
        if common:
            blocks.append(estimates_table(common))
        if solution.derived:
            blocks.append("<h4>Derived from the parameters above</h4>")
            blocks.append(estimates_table(solution.derived))
        if scene_estimates:
            blocks.append(
                f"<details><summary>{counted(len(scene_estimates), 'parameter')} of single scenes"
                f"</summary>{estimates_table(scene_estimates)}</details>"
            )
    return "".join(blocks)


def _open(calibration: Calibration) -> str:
    undetermined = sentences(
        calibration.undetermined, "The captures determine all free parameters."
    )
    warnings = sentences(calibration.warnings, "The checks of the captures found nothing wrong.")
    return (
        f"<h3>Unidentifiable parameters</h3>{undetermined}"
        f"<h3>Warnings about the captures</h3>{warnings}"
    )


def _correlation(solutions: Mapping[str, Solution]) -> str:
    blocks = [
        f"<h3>{escape(name.capitalize())}</h3>" + strongest(solution) + correlations_table(solution)
        for name, solution in solutions.items()
        if len(solution.estimates) > 1
    ]
    if not blocks:
        return ""
    return (
        "<p>Correlation of the parameters' errors, from the covariance of the fit. Near 1 or "
        "\N{MINUS SIGN}1, the captures determine a combination of two parameters better than each "
        "of them. Columns have the numbers of the rows. A cell is empty if its value is below "
        "0.005 or a parameter is unidentifiable.</p>" + "".join(blocks)
    )


def _fit(calibration: Calibration, values: dict[str, Any]) -> str:
    costs = [
        [
            escape(name),
            str(max(len(solution.cost) - 1, 0)),
            *(number(solution.cost[end] if solution.cost else math.nan, ".3f") for end in (0, -1)),
        ]
        for name, solution in calibration.solutions.items()
    ]
    stages = [[escape(name), number(value, ".1f")] for name, value in values["stages"].items()]
    stages.append(["Total", number(values["seconds"], ".1f")])
    scenes = scenes_table(values["scenes"]) if values["scenes"] else ""
    return (
        "<p>The cost is the quantity that the fit minimises. For images it is the weighted mean "
        "squared residual; sensor noise alone gives 1.</p>"
        + table(["Fit", "Steps", "Cost at start", "Cost at end"], costs)
        + table(["Stage", "Seconds"], stages, total=True)
        + (f"<h3>Values by scene</h3>{scenes}" if scenes else "")
    )


def _before(held: dict[str, Any], name: str) -> str:
    return number(held["before"][name], ".3f")


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.1f} min"


def estimates_table(rows: Sequence[Estimate]) -> str:
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


def correlations_table(solution: Solution) -> str:
    """Return the correlation matrix; red cells are positive, blue cells negative."""
    names = [estimate.name for estimate in solution.estimates]
    matrix = solution.correlation
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
    matrix = solution.correlation
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


def _cell(names: Sequence[str], matrix: NDArray[np.float64], i: int, j: int) -> str:
    value = float(matrix[i, j])
    title = f"{names[i]}, {names[j]}: {value:.3f}"
    sign = "plus" if value > 0 else "minus"
    size = 0.0 if i == j else min(abs(value), 1.0)
    colour = f"background: rgba(var(--{sign}), {0.75 * size:.2f})"
    # An unidentifiable parameter has no correlation, not even on the diagonal.
    shown = number(value, ".2f") if abs(value) >= _LEAST_SHOWN else ""
    return f'<td style="{colour}" title="{escape(title)}">{"1" if i == j and shown else shown}</td>'


def scenes_table(values: dict[str, dict[str, float]]) -> str:
    """Return a table of values by scene, with a column for each name that any scene has."""
    names = list(dict.fromkeys(name for scene in values.values() for name in scene))
    rows = [
        [escape(scene), *(number(scene_values.get(name, math.nan), ".6g") for name in names)]
        for scene, scene_values in values.items()
    ]
    return table(["Scene", *names], rows)
