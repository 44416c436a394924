"""HTML elements of a report: page, tables, figures, bar charts, numbers and lists."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from starling.sim.report.style import STYLE

NONE = "\N{EN DASH}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"
MINUS = "\N{MINUS SIGN}"

Kind = Literal["first", "second", "third", "part"]


def page(title: str, header: str, sections: Mapping[str, tuple[str, str]]) -> str:
    """Build a self-contained page: inline style, embedded pictures, no scripts.

    Args:
        title: title of the browser window, as plain text.
        header: HTML above the links to the sections.
        sections: by anchor, the title as plain text and the body as HTML.
    """
    links = "".join(
        f'<a href="#{key}">{escape(heading)}</a>' for key, (heading, _) in sections.items()
    )
    bodies = "".join(
        f'<section id="{key}"><h2>{escape(heading)}</h2>{body}</section>'
        for key, (heading, body) in sections.items()
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body><main>"
        f"<header>{header}<nav>{links}</nav></header>{bodies}</main></body></html>\n"
    )


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1, total: bool = False
) -> str:
    """Build a table that scrolls if it is wider than the page.

    Args:
        head: Column titles.
        rows: Cells as HTML, each row as long as `head`.
        words: Number of text columns on the left; the others hold numbers.
        total: Whether the last row is a total.
    """
    sides = ["" if i < words else ' class="number"' for i in range(len(head))]
    titles = "".join(
        f'<th scope="col"{side}>{escape(title)}</th>'
        for title, side in zip(head, sides, strict=True)
    )
    body, sums = [], ' class="total"'
    for place, row in enumerate(rows, 1):
        first, *rest = row
        cells = "".join(
            f"<td{side}>{cell}</td>" for cell, side in zip(rest, sides[1:], strict=True)
        )
        last = total and place == len(rows)
        body.append(f'<tr{sums if last else ""}><th scope="row">{first}</th>{cells}</tr>')
    return (
        f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def number(value: float, digits: str = ".4g") -> str:
    """Format a number with a minus sign; a dash if it is not finite."""
    return format(value, digits).replace("-", MINUS) if math.isfinite(value) else NONE


def sentences(texts: Iterable[str], none: str) -> str:
    """Build a highlighted list, or the paragraph `none` if it is empty."""
    listed = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<ul class="open">{listed}</ul>' if listed else f"<p>{none}</p>"


def prose(*sentences: str, quiet: bool = False) -> str:
    """Build a paragraph of plain text."""
    kind = ' class="quiet"' if quiet else ""
    return f"<p{kind}>{escape(' '.join(sentences))}</p>"


def figure(png: bytes, caption: str, *, alt: str = "", over: str = "", sharp: bool = False) -> str:
    """Build a figure from a PNG.

    Args:
        png: content of the file.
        caption: HTML below the picture.
        alt: text alternative, as plain text.
        over: HTML overlay of the picture.
        sharp: whether enlarged pixels stay square.
    """
    kind = ' class="sharp"' if sharp else ""
    picture = f'<img src="{_source(png)}" alt="{escape(alt)}">'
    return (
        f'<figure{kind}><span class="frame">{picture}{over}</span>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def grid(figures: Iterable[str], *, columns: Literal[2, 3] = 2) -> str:
    """Arrange figures in columns, or in one column on a narrow screen."""
    return f'<div class="{"pairs" if columns == 2 else "threes"}">{"".join(figures)}</div>'


def _source(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def colour_bar(scale: bytes, low: str, high: str) -> str:
    """Build a colour bar from a PNG, between its lower and upper limits."""
    return f'<span class="bar">{low}<img src="{_source(scale)}" alt="">{high}</span>'


@dataclass(frozen=True, kw_only=True, slots=True)
class Bar:
    """One bar of a chart, from zero to its value."""

    name: str
    value: float  # NaN if unknown: no bar is drawn.
    text: str  # The value as text.
    low: float = math.nan  # Ends of the interval.
    high: float = math.nan
    kind: Kind = "first"  # Selects the colour.


def chart(bars: Sequence[Bar], *, line: float = math.nan) -> str:
    """Draw bars on one common axis that includes zero, each with its value as text.

    Args:
        bars: bars from top to bottom.
        line: position of a vertical line through all bars; NaN draws none.
    """
    ends = [0.0, line, *(end for bar in bars for end in (bar.value, bar.low, bar.high))]
    known = [end for end in ends if math.isfinite(end)]
    least, span = min(known), (max(known) - min(known)) or 1.0

    def between(start: float, end: float) -> str:
        offset = 100 * (min(start, end) - least) / span
        return f'style="left:{offset:.2f}%;width:{100 * abs(end - start) / span:.2f}%"'

    rows = []
    for bar in bars:
        drawn = f'<i class="zero" {between(0, 0)}></i>'
        if math.isfinite(bar.value):
            drawn += f'<i class="{bar.kind}" {between(0, bar.value)}></i>'
        if math.isfinite(bar.low) and math.isfinite(bar.high):
            drawn += f'<i class="whisker" {between(bar.low, bar.high)}></i>'
        if math.isfinite(line):
            drawn += f'<i class="line" {between(line, line)}></i>'
        rows.append(
            f'<li><span class="name">{escape(bar.name)}</span>'
            f'<span class="track" aria-hidden="true">{drawn}</span>'
            f'<span class="value">{escape(bar.text)}</span></li>'
        )
    return f'<ul class="bars">{"".join(rows)}</ul>'


@dataclass(frozen=True, kw_only=True, slots=True)
class Stack:
    """One bar of parts that sum to a whole."""

    name: str
    shares: Sequence[float]  # Of the parts, in the order of the legend.
    text: str


def stacks(rows: Sequence[Stack], legend: Sequence[str]) -> str:
    """Draw bars of parts below each other, with a legend.

    Args:
        rows: bars; shares below 0 are drawn as 0.
        legend: names of the parts, at most seven.
    """
    names = "".join(
        f'<span><i class="swatch part{place}"></i> {escape(name)}</span>'
        for place, name in enumerate(legend)
    )
    items = []
    for row in rows:
        shares = [max(share, 0.0) if math.isfinite(share) else 0.0 for share in row.shares]
        total, start, drawn = sum(shares) or 1.0, 0.0, ""
        for place, share in enumerate(shares):
            width = 100 * share / total
            drawn += f'<i class="part{place}" style="left:{start:.2f}%;width:{width:.2f}%"></i>'
            start += width
        spoken = ", ".join(
            f"{name} {100 * share / total:.0f} %"
            for name, share in zip(legend, shares, strict=True)
        )
        items.append(
            f'<li><span class="name">{escape(row.name)}</span>'
            f'<span class="track" role="img" aria-label="{escape(spoken)}">{drawn}</span>'
            f'<span class="value">{escape(row.text)}</span></li>'
        )
    return f'<p class="legend">{names}</p><ul class="bars">{"".join(items)}</ul>'


def listed(names: Iterable[str]) -> str:
    """Join names with commas."""
    return ", ".join(escape(name) for name in names) or "none"


def counted(count: int, noun: str) -> str:
    """Return a number with its noun: 1 room, 2 rooms."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def points(share: float) -> str:
    """Format a difference of shares in percentage points."""
    return f"{number(100 * share, '+.2f')} points"


def percent(share: float) -> str:
    """Format a share as a percentage."""
    return f"{number(100 * share, '.1f')} %" if math.isfinite(share) else NONE


def interval(low: float, high: float, digits: str) -> str:
    """Format an interval in brackets; a dash if it is unknown."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return NONE
    return f"[{number(low, digits)}, {number(high, digits)}]"
