"""Results as aligned text for a terminal, printed without `--json`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any


def render(value: Any) -> str:
    """Format nested tables as aligned lines; tables of equal rows become columns.

    Example:
        >>> print(render({"out": "sim", "scenes": {"a": {"fill": 0.9}, "b": {"fill": 0.8}}}))
        out  sim
        <BLANKLINE>
        scenes  fill
        a        0.9
        b        0.8
    """
    return re.sub(r"\n{3,}", "\n\n", "\n".join(_rows(value, "") or _lines(value, ""))).strip("\n")


def _lines(value: Any, title: str) -> list[str]:
    if isinstance(value, (list, tuple)) and value and all(isinstance(v, Mapping) for v in value):
        value = {str(number): row for number, row in enumerate(value)}
    if not isinstance(value, Mapping):
        return [_cell(value)]
    flat = {key: item for key, item in value.items() if not _is_table(item)}
    lines = [f"[{title}]"] if title and flat else []
    lines += _columns([[str(key), _cell(item)] for key, item in flat.items()], left=2)
    for key, item in value.items():
        if _is_table(item):
            name = f"{title} {key}".strip()
            lines += ["", *(_rows(item, name) or _lines(item, name))]
    return lines


def _rows(table: Any, title: str) -> list[str]:
    """Format a table of equal rows, or of tables of equal rows, in columns; otherwise `[]`."""
    if not isinstance(table, Mapping) or not all(map(_is_table, table.values())):
        return []
    rows = {str(key): row for key, row in table.items()}
    if all(_holds_tables(row) for row in rows.values()):
        rows = {f"{key} {sub}": row for key, item in rows.items() for sub, row in item.items()}
    if any(not isinstance(row, Mapping) or _holds_tables(row) for row in rows.values()):
        return []
    heads = list(dict.fromkeys(head for row in rows.values() for head in row))
    body = [[key, *(_cell(row.get(head, "")) for head in heads)] for key, row in rows.items()]
    return _columns([[title, *heads], *body], left=1)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value)


def _holds_tables(row: Any) -> bool:
    return isinstance(row, Mapping) and any(map(_is_table, row.values()))


def _columns(rows: Sequence[Sequence[str]], *, left: int) -> list[str]:
    """Align the first `left` columns to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_cell, value)) or "-"
    if isinstance(value, Mapping):
        return "-"
    return "-" if value is None else str(value)
