"""List what is not plain English in code and documents: `python tools/language.py [PATHS]`.

Prints a line for each banned word, each sentence of more than 25 words, and each name that is a
pronoun or participle. With `--rates` it prints rates by package instead. docs/style.md has the
rules; tests/architecture/test_language.py holds the limits.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("starling", "patterns", "sim", "calibration", "learning", "diagnosis")
FOLDERS = (*PACKAGES, "benchmarks", "examples", "tests")
LONGEST_SENTENCE = 25  # Words.

BANNED = re.compile(
    r"\b(told|tells?|telling|laid (?:on|onto|out)|lay onto|anew|by lot|beside|whatever|alike|"
    r"likewise|stands? for|as of what|is asked|are asked|asked of|lets go|mended|mends|parted|"
    r"apart from one another|thereof|nobody asked|ha[sd] no say|of which|puts? out|borne out|"
    r"bears? out|made up for|goes by|for want of|by birth|such as are|none of the(?!\s+known)|"
    r"held to account|"
    r"what (?:is|are|was|were) (?:told|asked|laid|drawn|known|left|put))\b",
    re.IGNORECASE,
)
PRONOUN = re.compile(
    "one|other|another|found|told|asked|of|by|own|at|left_over|given|given_by|made|beside|such|"
    "what|whose|all_|every|kept|said|here|there"
)
_WORD = re.compile(r"[A-Za-z][A-Za-z'\-]*")
_LITERAL = re.compile(r"^ {2,}.*$", re.MULTILINE)  # Indented lines of a module's docstring.
_CODE = re.compile(r"`[^`]{1,400}`")
_END = re.compile(r"(?<=[.!?:])\s+(?=[A-Z`(\[\"'-])|;\s|\n\s*\n|\n\s*(?=[-*|#>]|\d+\. |\w+: )")


@dataclass(frozen=True)
class Finding:
    """A place that is not plain: what is wrong there, and the words."""

    place: str
    rule: str
    text: str


@dataclass(frozen=True)
class Rates:
    """Rates of one package."""

    words: int
    banned_per_1000: float
    pronoun_names_pct: float
    long_sentences: int


def prose(source: str) -> Iterator[tuple[int, str]]:
    """Yield (line, text) of every docstring and comment of a Python source."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text and isinstance(node, ast.Module):
                text = _LITERAL.sub("", text)
            if text:
                yield node.body[0].lineno, text
    yield from _comments(source)


def _comments(source: str) -> Iterator[tuple[int, str]]:
    """Yield comments; lines of comment that follow each other are one text."""
    start, lines = 0, list[str]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        alone = not token.line[: token.start[1]].strip()
        if lines and (not alone or token.start[0] != start + len(lines)):
            yield start, "\n".join(lines)
            lines = []
        if not lines:
            start = token.start[0]
        lines.append(token.string.lstrip("#: "))
        if not alone:
            yield start, lines.pop()
    if lines:
        yield start, "\n".join(lines)


def names(source: str) -> Iterator[tuple[int, str]]:
    """Yield (line, name) of every argument, assigned name, function and class."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name


def document(text: str) -> str:
    """Return the prose of a Markdown page: no code blocks, tables, formulas or addresses."""
    text = re.sub(r"^(```|~~~).*?^\1", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]+\$", "x", text, flags=re.DOTALL)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("|"))


def sentences(text: str) -> Iterator[str]:
    """Split prose into sentences. A semicolon ends one, and a colon before a capital."""
    for sentence in _END.split(_CODE.sub("X", text)):
        yield " ".join(sentence.split())


def too_long(text: str) -> Iterator[str]:
    """Yield sentences with more words than `LONGEST_SENTENCE`."""
    for sentence in sentences(text):
        if len(_WORD.findall(sentence)) > LONGEST_SENTENCE:
            yield sentence


def findings(path: Path) -> Iterator[Finding]:
    """List what is not plain in one Python file or Markdown page."""
    source = path.read_text(encoding="utf-8")
    place = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    python = path.suffix == ".py"
    for line, text in prose(source) if python else [(1, document(source))]:
        for word in BANNED.finditer(_CODE.sub(lambda code: "x" * len(code[0]), text)):
            at = line + text[: word.start()].count("\n") if python else line
            around = " ".join(text[max(0, word.start() - 30) : word.end() + 30].split())
            yield Finding(f"{place}:{at}", "banned word", around)
        for sentence in too_long(text):
            words = len(_WORD.findall(sentence))
            yield Finding(f"{place}:{line}", f"{words} words", sentence[:90])
    for line, name in names(source) if python else ():
        if PRONOUN.fullmatch(name.strip("_")):
            yield Finding(f"{place}:{line}", "name", name)


def rates(paths: list[Path]) -> Rates:
    """Return rates over files, as tests/architecture/test_language.py limits them."""
    words = banned = bound = pronouns = long = 0
    for path in paths:
        source = path.read_text(encoding="utf-8")
        python = path.suffix == ".py"
        for _, text in prose(source) if python else [(1, document(source))]:
            words += len(_WORD.findall(text))
            banned += len(BANNED.findall(_CODE.sub("X", text)))
            long += sum(1 for _ in too_long(text))
        for _, name in names(source) if python else ():
            bound += 1
            pronouns += PRONOUN.fullmatch(name.strip("_")) is not None
    return Rates(words, 1000 * banned / max(words, 1), 100 * pronouns / max(bound, 1), long)


def files(folder: str) -> list[Path]:
    """Return the Python files of a package, or the Markdown pages of `documents`."""
    if folder == "documents":
        return sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
    # `starling/` holds links to the other packages.
    return sorted(ROOT.joinpath(folder).glob("*.py" if folder == "starling" else "**/*.py"))


def main(arguments: list[str]) -> int:
    """Print findings of the named paths, or rates; return 1 where there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python tools/language.py")
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--rates", action="store_true", help="print rates by package")
    options = parser.parse_args(arguments)
    if options.rates:
        for folder in (*FOLDERS, "documents"):
            print(folder, rates(files(folder)))
        return 0
    paths = [path.resolve() for path in options.paths or map(Path, FOLDERS)]
    count = 0
    for path in paths:
        inside = [path] if path.is_file() else sorted([*path.rglob("*.py"), *path.rglob("*.md")])
        for finding in (finding for file in inside for finding in findings(file)):
            print(f"{finding.place}: {finding.rule}: {finding.text}")
            count += 1
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
