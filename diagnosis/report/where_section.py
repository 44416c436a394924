"""Where the gap lies, as a part of a page: parts of the chain, places, rules, bins."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import pictures, scene_section, sentences
from starling.diagnosis.report.elements import Bar, chart, interval, percent, picture, points, prose
from starling.diagnosis.report.words import Words, words
from starling.diagnosis.where import frames
from starling.diagnosis.where.covariates import Row
from starling.diagnosis.where.location import OFF_PX
from starling.diagnosis.where.maps import CAMERA, FIELD, Map, OfBody
from starling.diagnosis.where.rules import Rule
from starling.diagnosis.where.swap import Part
from starling.sim.report.elements import bar, number, table

ROWS = 15  # Of the bins, those of the smallest chance,
FEWER = 8  # and of those of depth that is off.
BODIES = 12  # Of the objects, those with most of the gap.
_CLEAR = 3.0  # Deviations.


@dataclass(frozen=True, slots=True)
class _Figure:
    title: str
    unit: str
    scale: float
    digits: str
    less: str  # Unit of a difference.


_FIGURES = {
    "ndp_rate": _Figure("Pixels without depth", "%", 100, ".2f", "points"),
    "bias_px": _Figure("Bias of disparity", "px", 1, ".3f", "px"),
    "nmad_px": _Figure("Spread of disparity (NMAD)", "px", 1, ".3f", "px"),
    "bad1_pct": _Figure("Pixels off by more than 1 px", "%", 1, ".2f", "points"),
}


@dataclass(frozen=True, slots=True)
class _Quantity:
    title: str  # With room for both sides of the gap.
    red: str  # With room for the side whose more is red.
    unit: str
    scale: float
    least: float  # Limit of the colours, in the map's own unit, that is never gone below.


_QUANTITIES = {
    "infrared": _Quantity("Infrared level, logarithm of {} over {}", "{} is brighter", "", 1, 0.02),
    "error": _Quantity("Disparity, {} less {}", "{} has more disparity", "px", 1, 0.01),
    "holes": _Quantity("Pixels without depth, {} less {}", "{} has more", "points", 100, 0.005),
}


def section(of: Diagnosis) -> str:
    """Write the answer to the first question as HTML."""
    named = words(of.against)
    return (
        "<h3>Which half of the chain</h3>"
        + prose(f"Means over scenes. {named.stages}")
        + "".join(_part(name, part, named) for name, part in of.where.parts.items())
        + "<h3>Which places</h3>"
        + _maps(of)
        + f"<h3>One scene: {escape(of.shown.scene)}</h3>"
        + scene_section.section(
            of.shown, named, locked=of.shown.scene in of.locked, tried=bool(of.arms)
        )
        + "<h3>Which objects</h3>"
        + _bodies(of.where.bodies, named)
        + "<h3>Which rules</h3>"
        + _rules(of.where.rules, named)
        + f"<h3>Which bins: the {min(ROWS, len(of.where.rows))} of the smallest chance</h3>"
        + _rows(of.where.rows[:ROWS], "holes", "pixels without depth", named)
        + f"<h3>Where depth is off by more than {OFF_PX:g} px</h3>"
        + _rows(of.where.off[:FEWER], "errors", "pixels whose depth is so far off", named)
    )


def _part(name: str, part: Part, named: Words) -> str:
    figure = _FIGURES[name]

    def told(value: float | None) -> str:
        if value is None:
            return "not captured"
        return f"{number(figure.scale * value, figure.digits)} {figure.unit}".rstrip()

    def scaled(value: float | None) -> float:
        return math.nan if value is None else figure.scale * value

    bars = [
        Bar(name=named.images[0], value=scaled(part.base), told=told(part.base)),
        Bar(
            name=named.images[1],
            value=scaled(part.rematched),
            told=told(part.rematched),
            kind="second",
        ),
        Bar(name="C device", value=scaled(part.device), told=told(part.device), kind="third"),
    ]
    if part.base_device is not None:
        other = part.base_device
        bars.append(Bar(name=named.own, value=scaled(other), told=told(other), kind="third"))
    for title, found in (
        ("B less A: images", part.image),
        ("C less B: matcher and filters", part.matcher),
    ):
        if found is None:
            continue
        mean, low, high = map(scaled, found)
        ends = interval(low, high, "+" + figure.digits)
        told_mean = f"{number(mean, '+' + figure.digits)} {ends} {figure.less}".rstrip()
        bars.append(Bar(name=title, value=mean, low=low, high=high, told=told_mean, kind="part"))
    return f"<h4>{escape(figure.title)}</h4>{chart(bars)}"


def _maps(of: Diagnosis) -> str:
    if not of.where.maps:
        return prose("One room alone: a map of what rooms have in common needs two.")
    info = of.shown.ground.info
    parts = [
        prose(
            "Means over rooms. What imager and lens do stays at its place in the camera's image, "
            "what the projector does at its place in the projector's field. Grey: too few pixels "
            "of two rooms. One scale of colours for both frames."
        )
    ]
    named = words(of.against)
    for quantity, blank in _QUANTITIES.items():
        some = [one for one in of.where.maps if one.quantity == quantity]
        if not some:
            continue
        filled = dataclasses.replace(
            blank, title=blank.title.format(*named.pair), red=blank.red.format(named.more)
        )
        limit = pictures.limit(some, least=filled.least)
        drawn = "".join(_map(one, filled, limit, info.height / info.width) for one in some)
        told = frames.frame(some, quantity)
        stays = (
            "Rooms do not agree about its place."
            if told is None
            else f"As far as these rooms tell, its place {sentences.FRAMES[told]}."
        )
        ends = [f"{number(end * filled.scale, '+.3g')} {filled.unit}" for end in (-limit, limit)]
        parts.append(
            f'<h4>{escape(filled.title)}</h4><div class="pairs">{drawn}</div>'
            f'<div class="scale">{bar(pictures.scale(), *map(escape, ends))}'
            f"red: {escape(filled.red)}</div>" + prose(stays, quiet=True)
        )
    return "".join(parts)


def _map(one: Map, of: _Quantity, limit: float, aspect: float) -> str:
    """Draw a map, of the projector's the part that is known.

    Args:
        one: the map.
        of: its quantity.
        limit: of the colours.
        aspect: height of the image over its width.
    """
    known = np.isfinite(one.mean)
    frame = "Camera frame" if one.frame == CAMERA else "Projector frame"
    if not known.any():
        return f"<div>{prose(f'{frame}: too few pixels in every cell.', quiet=True)}</div>"
    mean = one.mean
    rows, columns = mean.shape
    if one.frame != CAMERA:
        aspect = 1.0
        down, across = (_reach(known, axis) for axis in (1, 0))
        mean = mean[down, across]
        frame += f", tangents {_tangents(across, columns)} by {_tangents(down, rows)}"
    strongest = float(one.mean[known][np.argmax(np.abs(one.mean[known]))])
    clear = int(np.count_nonzero(np.abs(one.deviations[known]) > _CLEAR))
    told = (
        f"strongest {number(of.scale * strongest, '+.3g')} {of.unit}".rstrip()
        + f"; beyond {_CLEAR:.0f} deviations in {clear} of {int(known.sum())} cells"
    )
    return picture(
        pictures.heat(mean, limit, aspect=aspect * columns / rows),
        alt=f"{frame}. {of.title}: {told}.",
        caption=f"{frame}; {told}",
        sharp=True,
    )


def _reach(known: NDArray[np.bool_], axis: int) -> slice:
    """Rows (1) or columns (0) from the first to the last that is known, and one more each side."""
    lines = np.asarray(known.any(axis=axis))
    at = np.flatnonzero(lines)
    return slice(max(int(at[0]) - 1, 0), min(int(at[-1]) + 2, lines.size))


def _tangents(cells: slice, count: int) -> str:
    ends = (FIELD * (2 * end / count - 1) for end in (cells.start, cells.stop))
    return " to ".join(number(end, ".2f") for end in ends)


def _bodies(bodies: tuple[OfBody, ...], named: Words) -> str:
    if len(bodies) < 2:
        return prose("Of the scenes no objects are known apart.")
    most = sorted(bodies, key=lambda one: -abs(one.holes * one.pixels))[:BODIES]
    cells = [
        [
            escape(one.scene),
            escape(one.name),
            escape(one.material),
            f"{one.pixels:,}",
            points(one.holes),
            number(one.infrared, "+.3f"),
        ]
        for one in most
    ]
    head = ["Scene", "Object", "Material", "Pixels", "Gap in holes", "Infrared, log ratio"]
    return table(head, cells, words=3) + prose(
        f"The {len(most)} with most pixels gained or lost, of {len(bodies)}. Gap: {named.pair[0]} "
        f"less {named.pair[1]}.",
        quiet=True,
    )


def _rules(rules: tuple[Rule, ...], named: Words) -> str:
    if not rules:
        return prose("No rule about holes was found that other scenes confirm.")
    said = []
    for rule in rules:
        word = "more" if rule.gap >= 0 else "fewer"
        text = (
            f"Where {rule.text}, {named.have[0]} have {number(100 * abs(rule.gap), '.1f')} points "
            f"{word} pixels without depth than {named.have[1]}; this is {percent(rule.area)} of "
            "the pixels"
        )
        if math.isfinite(rule.share):
            text += f" and {number(100 * rule.share, '.0f')} % of the whole gap"
        said.append(f"<li>{escape(text)}.</li>")
    return f"<ul>{''.join(said)}</ul>"


def _rows(rows: tuple[Row, ...], quantity: str, counted: str, named: Words) -> str:
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
    head = ["By", "Bin", f"Gap in {quantity}", "95 %", "Of the pixels", "Of the gap", "Chance"]
    return table(head, cells, words=2) + prose(
        f"Gap: {counted}, {named.pair[0]} less {named.pair[1]}. Chance: of as large a "
        "gap in any bin, were the signs of rooms arbitrary; n rooms cannot make it less than 2 of "
        "2^n.",
        quiet=True,
    )
