"""The command line as tests type it."""

from __future__ import annotations

import pytest

from starling import command_line

Capsys = pytest.CaptureFixture[str]


def run(*arguments: object, capsys: Capsys) -> tuple[int, str, str]:
    """Run a command; return its exit code and what it said on both outputs."""
    code = command_line.main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def refused(*arguments: object, capsys: Capsys) -> str:
    """Run what must be refused; return its one line."""
    code, out, err = run(*arguments, capsys=capsys)
    assert (code, out) == (1, "")
    assert err.startswith("starling: ") and err.count("\n") == 1, err
    return err
