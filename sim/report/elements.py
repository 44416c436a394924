"""HTML elements of a report: tables, figures, numbers and lists."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape

NONE = "\N{EN DASH}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"
MINUS = "\N{MINUS SIGN}"


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


def figure(png: bytes, caption: str, over: str = "", *, zoomed: bool = False) -> str:
    """Build a figure with an HTML caption and an HTML overlay; zoomed figures keep sharp pixels."""
    kind = ' class="zoomed"' if zoomed else ""
    return (
        f'<figure{kind}><span class="frame"><img src="{_source(png)}" alt="">{over}</span>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _source(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def bar(scale: bytes, low: str, high: str) -> str:
    """Build a colour bar from a PNG, between its lower and upper limits."""
    return f'<span class="bar">{low}<img src="{_source(scale)}" alt="">{high}</span>'


def listed(names: Iterable[str]) -> str:
    """Join names with commas."""
    return ", ".join(escape(name) for name in names) or "none"


def counted(count: int, noun: str) -> str:
    """Return a number with its noun: 1 room, 2 rooms."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
