"""Progress on standard error that is no terminal: few lines, and the last one."""

from __future__ import annotations

import itertools

import pytest

from starling.sim.console import progress


@pytest.mark.parametrize(
    "item_s, printed",
    [
        (0.1, []),  # The whole loop is shorter than the interval.
        (2.4, ["5/6", "6/6"]),
        (11.0, ["1/6", "2/6", "3/6", "4/6", "5/6", "6/6"]),
    ],
)
def test_lines_are_ten_seconds_apart(
    item_s: float,
    printed: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    clock = itertools.count()
    monkeypatch.setattr(progress.time, "monotonic", lambda: item_s * next(clock))
    with progress.on_stderr() as track:
        assert list(track(range(6), "work")) == list(range(6))
    assert capsys.readouterr().err.splitlines() == [f"work {line}" for line in printed]
