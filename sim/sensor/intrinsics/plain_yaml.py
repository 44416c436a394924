"""Plain YAML: tables, lists and words, as in a `camera_info`; no library is needed for them.

Words stay text. Comments, quotes, `---`, tags and JSON are read. Anchors, aliases and texts of
several lines are refused. Source: YAML 1.2.2, chapters 6 to 8.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

_QUOTED = r"\"(?:[^\"\\]|\\.)*\"|'(?:[^']|'')*'"
_CONTENT = re.compile(rf"((?:{_QUOTED}|(?<!\s)#|[^#])*?)(?:(?:^|(?<=\s))#.*)?$")
_DOCUMENT = re.compile(r"(---|\.\.\.)(\s|$)")
_KEY = re.compile(rf"({_QUOTED}|[\w./~-][\w./~ -]*?)\s*:(?:\s+|$)")
_ITEM = re.compile(r"-(?:\s+|$)")
_TAG = re.compile(r"![^\s,\[\]{}]*\s*")
_FLOW_WORD = re.compile(rf"\s*({_QUOTED}|[^\[\]{{}},:\"'&*!|>][^\[\]{{}},:]*)")
_SPECIAL = "&*|>?@`%"  # They start what is not supported.


@dataclass(frozen=True, slots=True)
class _Line:
    indent: int
    text: str


def parse(text: str) -> Any:
    """Read the first document of a text.

    Raises:
        ValueError: for other YAML, or a key that is there twice. The message quotes the place.
    """
    lines = _lines(text)
    if not lines:
        raise ValueError("it is empty")
    try:
        value, end = _block(lines, 0)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    if end < len(lines):
        raise _unreadable(lines[end].text)
    return value


def _lines(text: str) -> list[_Line]:
    """Return the lines of the first document without comments; open brackets join lines."""
    result: list[_Line] = []
    depth = 0
    for line in text.splitlines():
        if _DOCUMENT.match(line) and not depth:
            if result:
                break
            continue
        match = _CONTENT.match(line)
        content = (match[1] if match else line).rstrip()
        words = content.strip()
        if not words or (words.startswith("%") and not result):
            continue
        if depth:
            result[-1] = _Line(result[-1].indent, f"{result[-1].text} {words}")
        else:
            result.append(_Line(len(content) - len(content.lstrip(" ")), words))
        bare = re.sub(_QUOTED, "", words)
        depth += sum(bare.count(sign) for sign in "[{") - sum(bare.count(sign) for sign in "]}")
    return result


def _block(lines: list[_Line], start: int) -> tuple[Any, int]:
    """Read a table, list or value, and return it with the number of the next line."""
    text = lines[start].text
    if _ITEM.match(text):
        return _list(lines, start)
    if _KEY.match(text):
        return _table(lines, start)
    return _value(text), start + 1


def _table(lines: list[_Line], start: int) -> tuple[dict[str, Any], int]:
    table: dict[str, Any] = {}
    place, indent = start, lines[start].indent
    while place < len(lines) and lines[place].indent == indent:
        match = _KEY.match(lines[place].text)
        if not match:
            break
        key, rest = _word(match[1]), _without_tag(lines[place].text[match.end() :])
        value, place = _after(lines, place, rest, lists_at=indent)
        _add(table, key, value)
    return table, place


def _list(lines: list[_Line], start: int) -> tuple[list[Any], int]:
    values: list[Any] = []
    place, indent = start, lines[start].indent
    while place < len(lines) and lines[place].indent == indent:
        match = _ITEM.match(lines[place].text)
        if not match:
            break
        rest = _without_tag(lines[place].text[match.end() :])
        value, place = _after(lines, place, rest, lists_at=indent + 1)
        values.append(value)
    return values, place


def _after(lines: list[_Line], place: int, rest: str, *, lists_at: int) -> tuple[Any, int]:
    """Read what follows a key or a dash: on its line, or in the lines below."""
    below = place + 1
    if rest:
        return _value(rest), below
    if below < len(lines):
        deeper = lines[below].indent > lines[place].indent
        if deeper or (lines[below].indent == lists_at and _ITEM.match(lines[below].text)):
            return _block(lines, below)
    return "", below


def _add(table: dict[str, Any], key: str, value: Any) -> None:
    if key in table:
        raise ValueError(f"the key {key!r} is there twice")
    table[key] = value


def _value(text: str) -> Any:
    if text[0] in _SPECIAL:
        raise _unreadable(text)
    if text[0] not in "[{\"'":
        return text
    value, rest = _flow(text)
    if rest.strip():
        raise _unreadable(rest)
    return value


def _flow(text: str) -> tuple[Any, str]:
    """Read a value inside brackets, and return it with the text behind it."""
    text = _without_tag(text.lstrip())
    if text[:1] not in ("[", "{"):
        match = _FLOW_WORD.match(text)
        if not match:
            raise _unreadable(text)
        return _word(match[1]), text[match.end() :]
    is_table, close = text[0] == "{", "]}"[text[0] == "{"]
    table: dict[str, Any] = {}
    values: list[Any] = []
    rest = text[1:].lstrip()
    while not rest.startswith(close):
        value, rest = _flow(rest)
        rest = rest.lstrip()
        if is_table:
            if not isinstance(value, str) or not rest.startswith(":"):
                raise _unreadable(rest)
            entry, rest = _flow(rest[1:])
            rest = rest.lstrip()
            _add(table, value, entry)
        values.append(value)
        if not rest.startswith((",", close)):
            raise _unreadable(rest)
        rest = rest.removeprefix(",").lstrip()
    return table if is_table else values, rest[1:]


def _word(text: str) -> str:
    text = text.strip()
    if text[:1] == '"':
        return str(json.loads(text))
    return text[1:-1].replace("''", "'") if text[:1] == "'" else text


def _without_tag(text: str) -> str:
    match = _TAG.match(text)
    return text[match.end() :] if match else text


def _unreadable(text: str) -> ValueError:
    return ValueError(f"{text[:40]!r} cannot be read" if text else "it ends inside brackets")
