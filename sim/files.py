"""Reading of files, with the file's name in error messages."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from starling.patterns import errors, regular_file
from starling.sim.sensor import structure

T = TypeVar("T")


def read_bytes(path: Path) -> bytes:
    """Read a file.

    Raises:
        InputError: if it cannot be read.
    """
    try:
        return regular_file.read(path)
    except OSError as error:
        name = path.name or "file"  # The working directory has no name.
        raise errors.refuse(name, "must be readable", path, f"{error.strerror}.") from error


def read_text(path: Path) -> str:
    """Read a UTF-8 text.

    Raises:
        InputError: if the file cannot be read, or is not UTF-8.
    """
    return decode(read_bytes(path), path)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits.

    Raises:
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def decode(data: bytes, path: Path) -> str:
    """Decode UTF-8; a byte order mark is skipped.

    Raises:
        InputError: if the data are not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise errors.refuse(path.name, "must be UTF-8 text", path, "Save it again.") from error


def parse_json(data: bytes, path: Path) -> Any:
    """Parse JSON; a byte order mark is skipped.

    Raises:
        InputError: if the data are no UTF-8 or no JSON, or a text cannot be written as UTF-8. Also
            if an object has a key twice.
    """
    text = decode(data, path)
    try:
        value = json.loads(text, object_pairs_hook=_unique)
        if "\\ud" in text.lower():  # An escape can be half of a character.
            json.dumps(value, ensure_ascii=False).encode()
        return value
    except (ValueError, RecursionError) as error:
        raise errors.refuse(path.name, "must be JSON", path, f"{error}.") from error


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build an object; readers disagree on which of two equal keys counts."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in table if names.count(name) > 1)
        raise ValueError(f"the key {twice!r} is there twice")
    return table


def read_toml(path: Path, build: Callable[[dict[str, Any]], T]) -> T:
    """Read a TOML file and build an object from its table.

    Args:
        path: the file; error messages start with its name.
        build: builds the result from the table.

    Raises:
        InputError: if the file is missing or no TOML; also as `build`, with the path in front.
    """
    return parse_toml(read_bytes(path), path, build)


def parse_toml(data: bytes, path: Path, build: Callable[[dict[str, Any]], T]) -> T:
    """Parse TOML and build an object; raises as `read_toml`. A byte order mark is skipped."""
    try:
        table = tomllib.loads(data.decode("utf-8-sig"))
        with errors.naming(path):
            structure.refuse_long_integers(table, "")
    except errors.InputError:
        raise
    except (ValueError, RecursionError) as error:  # No TOML, no UTF-8, or nested too deep.
        raise errors.refuse(path.name, "must be TOML", path, f"{error}.") from error
    with errors.naming(path):
        return build(table)
