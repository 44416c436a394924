"""Progress of the bench; its measurements are tested in tests/system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from starling.sim.commands import bench


def test_progress_covers_all_rounds_and_the_first_is_not_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter([0.0, 100.0] * 10 + [0.0, 1.0] * 20)  # 100 s to compile, then 1 s each.
    shot = SimpleNamespace(layers=None, ir_left=None, ir_right=None)
    monkeypatch.setattr(bench, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    for name in (
        "backend",
        "direct",
        "simulate",
        "MitsubaScene",
        "scenes",
        "dataclasses",
    ):
        monkeypatch.setattr(bench, name, _Anything(shot))
    monkeypatch.setattr(bench, "_floor", lambda *_: lambda *_: None)
    monkeypatch.setattr(bench, "_all_on", lambda scene, sensor: (scene, sensor))
    monkeypatch.setattr(bench, "_effects", lambda *_: lambda: None)
    monkeypatch.setattr(bench, "_moving", lambda *_: lambda: None)
    rounds = []

    def track(items: Sequence[Any], label: str) -> Iterable[Any]:
        assert label == "bench"
        for item in items:
            rounds.append(item)
            yield item

    assert bench.bench(repeats=2, track=track)["pipeline_s"] == 1.0
    assert len(rounds) == 3


class _Anything:
    """Has every function; each returns `value`."""

    def __init__(self, value: Any) -> None:
        self._value = value

    def __call__(self, *_: Any, **__: Any) -> Any:
        return self._value

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self._value if name != "mitsuba" else _Anything("x")
