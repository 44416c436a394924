"""HTML elements of a diagnosis page: bar charts, pictures, paragraphs, formatted numbers."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from starling.sim.report.elements import NONE, number

Kind = Literal["first", "second", "third", "part"]


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


def picture(png: bytes, *, alt: str, caption: str, sharp: bool = False) -> str:
    """Embed a picture in the page.

    Args:
        png: file content.
        alt: text alternative.
        caption: text below the picture.
        sharp: whether enlarged pixels stay square.
    """
    source = base64.b64encode(png).decode("ascii")
    kind = ' class="sharp"' if sharp else ""
    return (
        f'<figure{kind}><img src="data:image/png;base64,{source}" alt="{escape(alt)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def prose(*sentences: str, quiet: bool = False) -> str:
    """Write a paragraph of plain text."""
    kind = ' class="quiet"' if quiet else ""
    return f"<p{kind}>{escape(' '.join(sentences))}</p>"


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
