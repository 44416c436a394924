"""The language of code and documents: banned words, sentence length, names (docs/style.md)."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

from tests import script

ROOT = Path(__file__).parents[2]


language = script.load("tools/language.py")


@pytest.mark.parametrize("folder", language.FOLDERS)
def test_code_is_plain(folder: str) -> None:
    rates = language.rates(language.files(folder))
    assert rates.banned_per_1000 <= 0.5
    assert rates.pronoun_names_pct <= 1.0
    assert rates.long_sentences == 0


def test_documents_are_plain() -> None:
    rates = language.rates(language.files("documents"))
    assert rates.banned_per_1000 <= 0.5
    assert rates.long_sentences == 0


def test_readme_is_short() -> None:
    text = language.document((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(text.split()) <= 700


def test_class_names_are_unique() -> None:
    packages = [folder for folder in language.PACKAGES if folder != "starling"]
    classes = Counter(
        node.name
        for folder in packages
        for path in language.files(folder)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert {name: count for name, count in classes.items() if count > 1} == {}


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('"""It is told by lot."""\n', "banned word"),
        (f'"""{"word " * 26}."""\n', "26 words"),
        ("found = 1\n", "name"),
    ],
)
def test_what_is_not_plain_is_listed(text: str, rule: str, tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text(text, encoding="utf-8")
    assert {finding.rule for finding in language.findings(path)} == {rule}


@pytest.mark.parametrize(
    "text",
    [
        '"""Estimate the scale from dots."""\n',
        f'"""{"word " * 25}."""\n',
        '"""`told` is code."""\n',
        "# One fact a sentence. Another fact.\nscene = 1\n",
    ],
)
def test_plain_text_passes(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text(text, encoding="utf-8")
    assert list(language.findings(path)) == []
