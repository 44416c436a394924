"""TOML files: reading, and error messages with the file's name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from starling.patterns import InputError, errors
from starling.sim import files


def _width(table: dict[str, Any]) -> int:
    if "width" not in table:
        raise errors.refuse("width", "must be given", "nothing", "Give it.")
    return table["width"]


def test_file_is_built_from_its_table(tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    path.write_text("width = 3")
    assert files.read_toml(path, _width) == 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"^box.toml must be readable; got .*box.toml. No such file"),
        (b"width", r"^box.toml must be TOML; got .*box.toml. "),
        (b"width = '\xff'", r"^box.toml must be TOML; got .*box.toml. "),
        (b"a = " + b"[" * 10_000, r"^box.toml must be TOML; got .*box.toml. "),
        (b"[" + b".".join([b"a"] * 3000) + b"]", r"^box.toml must be TOML; .* recursion depth"),
        (b"", r"^\S*box.toml: width must be given; got nothing. Give it."),
    ],
)
def test_unreadable_files_are_refused(content: bytes | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        files.read_toml(path, _width)


def test_long_integers_are_refused(tmp_path: Path) -> None:
    """Python cannot print integers of over 4300 digits."""
    path = tmp_path / "box.toml"
    path.write_text("[[box]]\nwidth = [0x" + "f" * 6000 + "]")
    with pytest.raises(InputError, match=r"box\.toml: box\.width must fit in 64 bits; got a whole"):
        files.read_toml(path, repr)


def test_half_characters_in_json_are_refused() -> None:
    with pytest.raises(InputError, match=r"a.json must be JSON; got a.json\. .*surrogates"):
        files.parse_json(rb'{"a": "\ud800"}', Path("a.json"))
    assert files.parse_json(rb'["\ud83d\ude00"]', Path("a.json")) == ["\U0001f600"]


def test_keys_that_are_there_twice_in_json_are_refused() -> None:
    with pytest.raises(InputError, match=r"a.json must be JSON; .*the key 'gain' is there twice"):
        files.parse_json(b'{"a": {"gain": 1, "b": 2, "gain": 16}}', Path("a.json"))
