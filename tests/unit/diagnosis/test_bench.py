"""What a crew simulates while others wait for it."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.rows import Columns, Row
from starling.diagnosis.which.table import Bench
from starling.diagnosis.workers import Crew

SCENES = cast(tuple[Subject, ...], (SimpleNamespace(name="attic"), SimpleNamespace(name="hall")))
FLICKER, VEIL = {"flicker": 0.1}, {"veil": 0.04}  # One is drawn by lot, the other is not.


class Desk:
    """A crew that does all at once: a row is the sum of strengths and seed."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, str, int]] = []

    def submit(
        self, scene: str, work: Any, _: Columns, settings: dict[str, float], seed: int
    ) -> Future[Row]:
        self.asked.append((scene, work.__name__, repr(settings), seed))
        done: Future[Row] = Future()
        done.set_result(np.full(3, seed + sum(settings.values())))
        return done


def bench_of(desk: Desk | None, arm: Arm = Arm.IMAGE) -> Bench:
    columns = Columns(arm=arm, names=("a", "b", "c"), ceiling=255)
    return Bench(SCENES, columns, crew=cast(Crew | None, desk))


@pytest.mark.parametrize("arm", [Arm.IMAGE, Arm.DEPTH])
def test_what_is_begun_is_asked_once_and_changes_nothing(arm: Arm):
    plain, ahead = Desk(), Desk()
    one, other = bench_of(plain, arm), bench_of(ahead, arm)
    for settings in (FLICKER, VEIL, FLICKER):
        other.begin(settings)
    begun = list(ahead.asked)
    assert [name for name, *_ in begun[:2]] == ["attic", "hall"]  # Nobody waits for one scene.
    for settings in (VEIL, FLICKER):
        expected, found = one.change(settings), other.change(settings)
        assert expected is not None and found is not None
        np.testing.assert_array_equal(found, expected)
    assert len(set(ahead.asked)) == len(ahead.asked)
    assert sorted(ahead.asked) == sorted(plain.asked)
    base = {call for call in ahead.asked if call[1:] == ("simulated_row", "{}", 0)}
    assert set(ahead.asked) - set(begun) == base  # That is known before effects are asked for.
    devices = {seed for _, work, _, seed in begun if work == "another_row"}
    assert devices == ({1, 2, 3} if arm is Arm.IMAGE else set())


def test_one_process_alone_begins_nothing():
    bench_of(None).begin(FLICKER)  # It has no scene that could be simulated.
