"""Parser of a report page: its text, tables and pictures."""

from __future__ import annotations

import re
from html.parser import HTMLParser


class Reader(HTMLParser):
    """Collects text, table cells and pictures; fails if a tag stays open."""

    VOID_TAGS = frozenset({"meta", "img", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.pictures: list[dict[str, str]] = []
        self.rows: list[list[str]] = []
        self.words: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)
        self.close()
        assert self.open == []

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        known = {name: value or "" for name, value in attrs}
        assert not any(name.startswith("on") for name in known)
        if tag == "img":
            self.pictures.append(known)
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")
        if tag not in self.VOID_TAGS:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            assert "url(" not in data and "@import" not in data
            return
        self.words.append(data)
        if self.rows and self.open[-1:] and {"th", "td"} & set(self.open):
            self.rows[-1][-1] += data

    def row(self, *first: str) -> list[str]:
        """Return the only table row that begins with these cells."""
        (row,) = [row for row in self.rows if tuple(row[: len(first)]) == first]
        return row
