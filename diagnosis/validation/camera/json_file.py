"""Reading of JSON files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.camera.errors import refusal

_DIGITS = 20  # Longest whole number, with its sign; seeds have 62 bits.


def read(path: Path, name: str, advice: str = "") -> Any:
    """Read a JSON file.

    Raises:
        WithheldError: if the file is missing or no JSON.
    """
    try:
        return parse(path.read_bytes(), name, str(path), advice)
    except OSError as error:
        raise refusal(name, "must be a readable JSON file", path, f"{error}. {advice}") from error


def parse(data: bytes, name: str, place: str, advice: str = "") -> Any:
    """Parse JSON; a byte order mark is skipped.

    Args:
        data: UTF-8 text.
        name: name of the content in error messages.
        place: file or folder of the content in error messages.
        advice: what the user can do, as a whole sentence.

    Raises:
        WithheldError: if the data are no UTF-8, no JSON, or hold a whole number of over 20 digits.
    """
    try:
        return json.loads(data.decode("utf-8-sig"), parse_int=_whole_number)
    except (ValueError, RecursionError) as error:
        rule = "must be a readable JSON file"
        raise refusal(name, rule, place, f"{error}. {advice}") from error


def _whole_number(digits: str) -> int:
    if len(digits) > _DIGITS:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return int(digits)
