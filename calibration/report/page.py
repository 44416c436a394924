"""A calibration's report as one page that needs nothing beside it: `report.html`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

from starling.calibration.report import figures, heldout_section, pattern_section, tables
from starling.calibration.result import Calibration
from starling.calibration.solution import Solution
from starling.sim.report.elements import TIMES, counted, listed, number, sentences, table
from starling.sim.report.style import STYLE

_SECTIONS = {
    "parameters": "What was fitted",
    "open": "What the captures leave open",
    "heldout": "Does it render what the camera sees?",
    "pattern": "The pattern",
    "correlation": "Which numbers move together",
    "fit": "How the fit went",
}


def page(calibration: Calibration) -> str:
    """Write a calibration as an HTML page: inline style, pictures inside, no scripts.

    The figures are those of `starling.calibration.report.figures`; pictures show the held-out scenes that
    came out best, middling and worst.
    """
    found = figures.figures(calibration)
    bodies = {
        "parameters": _parameters(calibration),
        "open": _open(calibration),
        "heldout": heldout_section.section(calibration, found["heldout"]),
        "pattern": pattern_section.section(calibration.recovered) if calibration.recovered else "",
        "correlation": _correlation(calibration.solutions),
        "fit": _fit(calibration, found),
    }
    shown = {key: body for key, body in bodies.items() if body}
    links = "".join(f'<a href="#{key}">{_SECTIONS[key]}</a>' for key in shown)
    sections = "".join(
        f'<section id="{key}"><h2>{_SECTIONS[key]}</h2>{body}</section>'
        for key, body in shown.items()
    )
    title = f"Calibration of {escape(calibration.sensor.name)}"
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style></head><body><main>"
        f"<header><h1>{title}</h1>{_summary(calibration, found)}<nav>{links}</nav></header>"
        f"{sections}</main></body></html>\n"
    )


def _summary(calibration: Calibration, found: dict[str, Any]) -> str:
    sensor, held = calibration.sensor, found["heldout"]
    rooms = listed(calibration.fitted_rooms)
    groups = listed(calibration.solutions)
    text = (
        f"The sensor model <b>{escape(sensor.name)}</b> ({sensor.width} {TIMES} {sensor.height} "
        f"px) was fitted to captures of known surfaces so that it renders what the camera sees. "
        f"Fitted: {groups}. Captures: {counted(len(calibration.fitted_rooms), 'room')}, {rooms}. "
        "Numbers come with their standard deviation (sd); scores are of scenes in rooms that the "
        "fit has not seen."
    )
    loose = sum(not math.isfinite(one["sd"]) for one in found["parameters"].values())
    facts = [
        (
            "Held-out correlation",
            number(held["ncc"], ".3f"),
            f"ceiling {number(held['ceiling'], '.3f')}; before {_before(held, 'ncc')}",
        ),
        (
            "Its lower quartile",
            number(held["ncc_p25"], ".3f"),
            f"ceiling {number(held['ceiling_p25'], '.3f')}; before {_before(held, 'ncc_p25')}",
        ),
        ("Numbers fitted", str(len(found["parameters"])), f"{loose} of them not determined"),
        ("Left open", str(len(found["undetermined"])), "by these captures"),
        ("Warnings", str(len(found["warnings"])), "on the captures"),
        ("Time", _time(found["seconds"]), f"{counted(len(found['stages']), 'stage')}"),
    ]
    cells = "".join(
        f"<div><dt>{name}</dt><dd>{value}<small>{note}</small></dd></div>"
        for name, value, note in facts
    )
    return f'<p>{text}</p><dl class="facts">{cells}</dl>'


def _parameters(calibration: Calibration) -> str:
    parts = [
        '<p class="quiet">A name is a path in the sensor\'s file; <code>projector.field</code> is '
        "the tangent of the projector's half horizontal field. Places are in the frame of the left "
        "imager: x right, y down, z forward.</p>"
    ]
    for name, solution in calibration.solutions.items():
        common = [one for one in solution.estimates if not figures.scene_parameter(one.name)[1]]
        own = [one for one in solution.estimates if figures.scene_parameter(one.name)[1]]
        parts.append(f"<h3>{escape(name.capitalize())}</h3>")
        if common:
            parts.append(tables.estimates(common))
        if solution.derived:
            parts.append("<h4>Derived: combinations, and what follows from the above</h4>")
            parts.append(tables.estimates(solution.derived))
        if own:
            parts.append(
                f"<details><summary>{counted(len(own), 'number')} of single scenes</summary>"
                f"{tables.estimates(own)}</details>"
            )
    return "".join(parts)


def _open(calibration: Calibration) -> str:
    undetermined = sentences(
        calibration.undetermined, "The captures determine everything that was freed."
    )
    warnings = sentences(calibration.warnings, "Nothing in the captures speaks against them.")
    return f"<h3>Not determined</h3>{undetermined}<h3>Warnings on the captures</h3>{warnings}"


def _correlation(solutions: Mapping[str, Solution]) -> str:
    parts = [
        f"<h3>{escape(name.capitalize())}</h3>"
        + tables.strongest(solution)
        + tables.correlations(solution)
        for name, solution in solutions.items()
        if len(solution.estimates) > 1
    ]
    if not parts:
        return ""
    return (
        "<p>Correlation of the fitted numbers' errors, by the fit's covariance. Near 1 or "
        "\N{MINUS SIGN}1 the captures tell a combination better than its parts. Columns carry the "
        "rows' numbers; empty cells are below 0.005 or of a number that is not determined.</p>"
        + "".join(parts)
    )


def _fit(calibration: Calibration, found: dict[str, Any]) -> str:
    costs = [
        [
            escape(name),
            str(max(len(solution.cost) - 1, 0)),
            *(number(solution.cost[end] if solution.cost else math.nan, ".3f") for end in (0, -1)),
        ]
        for name, solution in calibration.solutions.items()
    ]
    stages = [[escape(name), number(value, ".1f")] for name, value in found["stages"].items()]
    stages.append(["Total", number(found["seconds"], ".1f")])
    scenes = tables.scenes(found["scenes"]) if found["scenes"] else ""
    return (
        "<p>Cost: what the fit brings down, at its start and end. Of images it is the weighted "
        "mean squared residual, where noise alone makes 1.</p>"
        + table(["Fit", "Steps", "Cost at start", "Cost at end"], costs)
        + table(["Stage", "Seconds"], stages, total=True)
        + (f"<h3>Scene by scene</h3>{scenes}" if scenes else "")
    )


def _before(held: dict[str, Any], name: str) -> str:
    return number(held["before"][name], ".3f")


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
