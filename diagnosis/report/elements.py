"""What a diagnosis's page is made of beside a report's common elements: bars, pictures, words."""

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
    value: float  # NaN where it is not known: no bar is drawn.
    told: str  # The value in words.
    low: float = math.nan  # Interval.
    high: float = math.nan
    kind: Kind = "first"  # Its colour.


def chart(bars: Sequence[Bar], *, line: float = math.nan) -> str:
    """Bars on one common axis that holds zero; numbers stand beside them as text.

    Args:
        bars: from the top.
        line: value at which a line is drawn through all of them; NaN draws none.
    """
    ends = [0.0, line, *(end for bar in bars for end in (bar.value, bar.low, bar.high))]
    known = [end for end in ends if math.isfinite(end)]
    least, span = min(known), (max(known) - min(known)) or 1.0

    def between(one: float, other: float) -> str:
        left = 100 * (min(one, other) - least) / span
        return f'style="left:{left:.2f}%;width:{100 * abs(other - one) / span:.2f}%"'

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
            f'<span class="told">{escape(bar.told)}</span></li>'
        )
    return f'<ul class="bars">{"".join(rows)}</ul>'


def picture(png: bytes, *, alt: str, caption: str, sharp: bool = False) -> str:
    """A picture inside the page.

    Args:
        png: file.
        alt: what it shows, for those who do not see it.
        caption: below it.
        sharp: its pixels stay squares where it is drawn larger.
    """
    source = base64.b64encode(png).decode("ascii")
    kind = ' class="sharp"' if sharp else ""
    return (
        f'<figure{kind}><img src="data:image/png;base64,{source}" alt="{escape(alt)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def prose(*sentences: str, quiet: bool = False) -> str:
    """A paragraph of plain text."""
    kind = ' class="quiet"' if quiet else ""
    return f"<p{kind}>{escape(' '.join(sentences))}</p>"


def points(share: float) -> str:
    """A difference of shares."""
    return f"{number(100 * share, '+.2f')} points"


def percent(share: float) -> str:
    """A share."""
    return f"{number(100 * share, '.1f')} %" if math.isfinite(share) else NONE


def interval(low: float, high: float, digits: str) -> str:
    """An interval in brackets; a dash where it is not known."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return NONE
    return f"[{number(low, digits)}, {number(high, digits)}]"
