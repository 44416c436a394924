"""Helpers that run the command line in tests."""

from __future__ import annotations

import math

import pytest

from starling import command_line
from starling.sim.console import progress

Capsys = pytest.CaptureFixture[str]


def run(*arguments: object, capsys: Capsys) -> tuple[int, str, str]:
    """Run a command; return its exit code, standard output and standard error."""
    code = command_line.main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def refused(*arguments: object, capsys: Capsys) -> str:
    """Run a command that must fail; return its one-line error.

    Progress is silent, because its lines depend on time.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, "_QUIET_S", math.inf)
        code, out, err = run(*arguments, capsys=capsys)
    assert (code, out) == (1, "")
    assert err.startswith("starling: ") and err.count("\n") == 1, err
    return err
