"""Report section on where the gap lies: pipeline segments, maps, objects, rules and bins."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import coherence_section, pictures, sentences
from starling.diagnosis.report.words import SideNames, side_names
from starling.diagnosis.where import frames
from starling.diagnosis.where.covariates import BinGap
from starling.diagnosis.where.location import WRONG_PX
from starling.diagnosis.where.maps import CAMERA, FIELD, BodyGap, GapMap
from starling.diagnosis.where.rules import GapRule
from starling.diagnosis.where.swap import StageFigures
from starling.sim.report.elements import (
    Bar,
    Kind,
    chart,
    colour_bar,
    figure,
    grid,
    interval,
    number,
    percent,
    points,
    prose,
    table,
)

ROWS = 15  # Number of bins listed for pixels without depth.
FEWER = 8  # Number of bins listed for pixels with wrong disparity.
BODIES = 12  # Number of objects listed.
_CLEAR = 3.0  # Standard deviations above which a cell counts as significant.


@dataclass(frozen=True, slots=True)
class _Figure:
    """How one figure of the stage ablation is written."""

    title: str
    unit: str
    scale: float
    digits: str
    difference_unit: str


_FIGURES = {
    "ndp_rate": _Figure("Pixels without depth", "%", 100, ".2f", "points"),
    "bias_px": _Figure("Disparity bias", "px", 1, ".3f", "px"),
    "nmad_px": _Figure("Disparity spread (NMAD)", "px", 1, ".3f", "px"),
    "bad1_pct": _Figure("Pixels wrong by more than 1 px", "%", 1, ".2f", "points"),
}


@dataclass(frozen=True, slots=True)
class _Quantity:
    """How the maps of one quantity are drawn."""

    title: str  # Template for the names of both sides.
    red: str  # Template for the side that has more where the map is red.
    unit: str
    scale: float
    least: float  # Smallest limit of the colour scale, in the unit of the map.


_QUANTITIES = {
    "infrared": _Quantity("Infrared level, log ratio of {} to {}", "{} is brighter", "", 1, 0.02),
    "error": _Quantity("Disparity, {} minus {}", "{} has larger disparity", "px", 1, 0.01),
    "holes": _Quantity("Pixels without depth, {} minus {}", "{} has more", "points", 100, 0.005),
}


def section(diagnosis: Diagnosis) -> str:
    """Write the section as HTML."""
    sides = side_names(diagnosis.against)
    listed = diagnosis.where.hole_bins[:ROWS]
    return (
        coherence_section.section(diagnosis.where.coherence, diagnosis.against)
        + "<h3>Pipeline segments: images or matcher</h3>"
        + prose(f"Means over scenes. {sides.stages}")
        + "".join(_part(name, part, sides) for name, part in diagnosis.where.parts.items())
        + "<h3>Maps</h3>"
        + _maps(diagnosis)
        + _remainder_maps(diagnosis)
        + _levels(diagnosis.where.levels, sides)
        + "<h3>Objects</h3>"
        + _bodies(diagnosis.where.bodies, sides)
        + "<h3>Rules</h3>"
        + _rules(diagnosis.where.rules, sides)
        + f"<h3>Bins: the {len(listed)} with the smallest p-values</h3>"
        + _rows(listed, "holes", "pixels without depth", sides)
        + f"<h3>Bins: disparity wrong by more than {WRONG_PX:g} px</h3>"
        + _rows(diagnosis.where.error_bins[:FEWER], "errors", "pixels with wrong disparity", sides)
    )


def _levels(levels: Mapping[str, float], sides: SideNames) -> str:
    """List the ratio of levels in each room, before any effect."""
    if not levels:
        return ""
    text = f"Median level above black of {sides.have[0]} over {sides.have[1]}, before any effect."
    rows = [[escape(room), number(ratio, ".3g")] for room, ratio in levels.items()]
    return f"<h3>Brightness by room</h3>{prose(text)}{table(['Room', 'Ratio of levels'], rows)}"


def _part(name: str, part: StageFigures, sides: SideNames) -> str:
    style = _FIGURES[name]

    def written(value: float | None) -> str:
        if value is None:
            return "not captured"
        return f"{number(style.scale * value, style.digits)} {style.unit}".rstrip()

    def scaled(value: float | None) -> float:
        return math.nan if value is None else style.scale * value

    stages: list[tuple[str, float | None, Kind]] = [
        (sides.images[0], part.base, "first"),
        (sides.images[1], part.rematched, "second"),
        ("C device", part.device, "third"),
    ]
    if part.base_device is not None:
        stages.append((sides.reference_depth, part.base_device, "third"))
    bars = [
        Bar(name=title, value=scaled(value), text=written(value), kind=kind)
        for title, value, kind in stages
    ]
    for title, difference in (
        ("B minus A: images", part.image),
        ("C minus B: matcher and filters", part.matcher),
    ):
        if difference is None:
            continue
        mean, low, high = map(scaled, difference)
        ends = interval(low, high, "+" + style.digits)
        mean_text = f"{number(mean, '+' + style.digits)} {ends} {style.difference_unit}".rstrip()
        bars.append(Bar(name=title, value=mean, low=low, high=high, text=mean_text, kind="part"))
    return f"<h4>{escape(style.title)}</h4>{chart(bars)}"


def _maps(diagnosis: Diagnosis) -> str:
    if not diagnosis.where.maps:
        return prose("Only one room: maps of what rooms have in common need at least two.")
    text = (
        "Means over rooms. Effects of imager and lens are fixed in the camera image; effects of "
        "the projector are fixed in the projector field. Grey: fewer than two rooms have enough "
        "pixels. Both frames share one colour scale, at whose ends the colours stop."
    )
    sides = side_names(diagnosis.against)
    return prose(text) + _drawn(diagnosis.where.maps, diagnosis, sides.pair, sides.more)


def _remainder_maps(diagnosis: Diagnosis) -> str:
    """Draw what stays of the gap once the reported effects are simulated."""
    left = [each for place in diagnosis.places.values() for each in place.maps]
    if not left or not diagnosis.settings:
        return ""
    sides = side_names(diagnosis.against)
    names = (sides.pair[0], f"{sides.pair[1]} with the reported effects")
    text = "Means over rooms. The simulation has the reported effects."
    return f"<h3>Maps of the remainder</h3>{prose(text)}" + _drawn(
        left, diagnosis, names, sides.more
    )


def _drawn(maps: Sequence[GapMap], diagnosis: Diagnosis, names: tuple[str, str], more: str) -> str:
    """Draw the maps of each quantity in both frames.

    Args:
        maps: maps of any quantities.
        diagnosis: their diagnosis.
        names: names of the captures and of what they are compared with.
        more: the side that has more where a map is red.
    """
    info = diagnosis.example.strata.info
    parts = []
    for quantity, blank in _QUANTITIES.items():
        pair = [each for each in maps if each.quantity == quantity]
        if not pair:
            continue
        filled = dataclasses.replace(
            blank, title=blank.title.format(*names), red=blank.red.format(more)
        )
        limit = pictures.limit(pair, least=filled.least)
        drawn = [_map(each, filled, limit, info.height / info.width) for each in pair]
        frame = frames.common_frame(pair, quantity)
        where = (
            "Rooms do not agree on its location."
            if frame is None
            else f"In these rooms its location {sentences.FRAMES[frame]}."
        )
        ends = [f"{number(end * filled.scale, '+.3g')} {filled.unit}" for end in (-limit, limit)]
        parts.append(
            f"<h4>{escape(filled.title)}</h4>{grid(drawn)}"
            f'<div class="scale">{colour_bar(pictures.scale(), *map(escape, ends))}'
            f"red: {escape(filled.red)}</div>" + prose(where, quiet=True)
        )
    return "".join(parts)


def _map(gap_map: GapMap, quantity: _Quantity, limit: float, aspect: float) -> str:
    """Draw a map; of a projector map only the known part.

    Args:
        gap_map: the map.
        quantity: its quantity.
        limit: value at which the colours saturate.
        aspect: height of the image over its width.
    """
    known = np.isfinite(gap_map.mean)
    frame = "Camera frame" if gap_map.frame == CAMERA else "Projector frame"
    if not known.any():
        return f"<div>{prose(f'{frame}: too few pixels in every cell.', quiet=True)}</div>"
    mean = gap_map.mean
    row_count, column_count = mean.shape
    if gap_map.frame != CAMERA:
        aspect = 1.0
        down, across = (_reach(known, axis) for axis in (1, 0))
        mean = mean[down, across]
        frame += f", tangents {_tangents(across, column_count)} by {_tangents(down, row_count)}"
    strongest = float(gap_map.mean[known][np.argmax(np.abs(gap_map.mean[known]))])
    clear = int(np.count_nonzero(np.abs(gap_map.deviations[known]) > _CLEAR))
    text = (
        f"strongest {number(quantity.scale * strongest, '+.3g')} {quantity.unit}".rstrip()
        + f"; above {_CLEAR:.0f} standard deviations in {clear} of {int(known.sum())} cells"
    )
    return figure(
        pictures.heat(mean, limit, aspect=aspect * column_count / row_count),
        escape(f"{frame}; {text}"),
        alt=f"{frame}. {quantity.title}: {text}.",
        sharp=True,
    )


def _reach(known: NDArray[np.bool_], axis: int) -> slice:
    """Return the known rows (1) or columns (0), and one more on each side."""
    lines = np.asarray(known.any(axis=axis))
    known_lines = np.flatnonzero(lines)
    return slice(max(int(known_lines[0]) - 1, 0), min(int(known_lines[-1]) + 2, lines.size))


def _tangents(cells: slice, count: int) -> str:
    ends = (FIELD * (2 * end / count - 1) for end in (cells.start, cells.stop))
    return " to ".join(number(end, ".2f") for end in ends)


def _bodies(bodies: tuple[BodyGap, ...], sides: SideNames) -> str:
    if len(bodies) < 2:
        return prose("The objects of these scenes are not known individually.")
    most = sorted(bodies, key=lambda body: -abs(body.holes * body.pixels))[:BODIES]
    cells = [
        [
            escape(body.scene),
            escape(body.name),
            escape(body.material),
            f"{body.pixels:,}",
            points(body.holes),
            number(body.infrared, "+.3f"),
        ]
        for body in most
    ]
    head = ["Scene", "Object", "Material", "Pixels", "Gap in holes", "Infrared, log ratio"]
    return table(head, cells, words=3) + prose(
        f"The {len(most)} objects with the most pixels gained or lost, of {len(bodies)}. "
        f"Gap: {sides.pair[0]} minus {sides.pair[1]}.",
        quiet=True,
    )


def _rules(rules: tuple[GapRule, ...], sides: SideNames) -> str:
    if not rules:
        return prose("No rule about holes was confirmed by the other rooms.")
    items = []
    for rule in rules:
        word = "more" if rule.gap >= 0 else "fewer"
        text = (
            f"Where {rule.text}, {sides.have[0]} have {number(100 * abs(rule.gap), '.1f')} points "
            f"{word} pixels without depth than {sides.have[1]}; this is {percent(rule.area)} of "
            "the pixels"
        )
        if math.isfinite(rule.share):
            text += f" and {number(100 * rule.share, '.0f')} % of the whole gap"
        items.append(f"<li>{escape(text)}.</li>")
    return f"<ul>{''.join(items)}</ul>"


def _rows(rows: tuple[BinGap, ...], quantity: str, counted: str, sides: SideNames) -> str:
    if not rows:
        return prose("No bin holds enough pixels.")
    cells = [
        [
            escape(row.covariate),
            escape(row.bin),
            points(row.gap),
            interval(100 * row.low, 100 * row.high, "+.2f"),
            percent(row.area),
            percent(row.share),
            number(row.p, ".3g"),
        ]
        for row in rows
    ]
    head = ["Covariate", "Bin", f"Gap in {quantity}", "95 %", "Of pixels", "Of the gap", "p-value"]
    return table(head, cells, words=2) + prose(
        f"Gap: {counted}, {sides.pair[0]} minus {sides.pair[1]}. p-value: probability of as large "
        "a gap in any bin if the sign of each room's gap were random. With n rooms it is at least "
        "2 / 2^n.",
        quiet=True,
    )
