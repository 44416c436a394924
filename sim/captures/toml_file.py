"""Reading of TOML files, with the file's name in error messages."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from starling.patterns import errors

T = TypeVar("T")


def read(path: Path, build: Callable[[dict[str, Any]], T]) -> T:
    """Read a TOML file and build an object from its table.

    Args:
        path: the file; error messages start with its name.
        build: builds the result from the table.

    Raises:
        InputError: if the file is missing or no TOML; also as `build`, with the path in front.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise errors.refuse(path.name, "must be readable", path, f"{error.strerror}.") from error
    except (ValueError, RecursionError) as error:  # No TOML, no UTF-8, or nested too deep.
        raise errors.refuse(path.name, "must be TOML", path, f"{error}.") from error
    try:
        return build(table)
    except errors.InputError as error:
        raise errors.InputError(f"{path}: {error}") from error
