"""When a gap counts as explained, and when nothing is looked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import segment
from starling.diagnosis.which.candidates import Arm
from tests.unit.diagnosis.made_gaps import (
    BASE,
    FEATURES,
    SCENES,
    SIGNATURES,
    FakeBench,
    noise,
    screen,
)


class Captured(FakeBench):
    """With readings of captures."""

    names = tuple(f"feature {number}" for number in range(FEATURES))

    def __init__(self, real: np.ndarray, arm: Arm = Arm.IMAGE) -> None:
        super().__init__()
        self.arm = arm
        self._real = real

    def real(self) -> np.ndarray:
        return self._real


def found(settings: dict[str, float], *, of_seeds: float, arm: Arm = Arm.IMAGE) -> segment.Found:
    change = FakeBench().change(settings)
    assert change is not None
    bench: Any = Captured(change + noise(7), arm)
    return segment.diagnosed(bench, screen(*SIGNATURES, noise=of_seeds))


@pytest.mark.parametrize("arm, share", [(Arm.IMAGE, 0.04), (Arm.WHOLE, 0.04), (Arm.DEPTH, 0.1)])
@pytest.mark.parametrize("of_seeds, most", [(0.2, 0.55), (0.5, 0.65), (0.9, 0.9)])
def test_a_gap_is_explained_up_to_what_seeds_make_and_a_share_of_it(
    of_seeds: float, most: float, arm: Arm, share: float
):
    told = found({"crosstalk": 0.4}, of_seeds=of_seeds, arm=arm)
    before, _ = told.sizes
    assert before > 5
    assert told.explained_below == pytest.approx(most + share * before)


def test_nothing_is_looked_for_where_seeds_make_as_much():
    told = found({"crosstalk": 0.4}, of_seeds=0.9)
    before, _ = told.sizes
    assert told.settings and not found({"crosstalk": 0.4}, of_seeds=before + 1).settings


def test_a_gap_is_unexplained_where_more_is_left():
    """What nothing in the table makes: every second feature is off by as much."""
    bench: Any = Captured(noise(7) + 0.5 * (-1.0) ** np.arange(FEATURES))
    asked = screen(*SIGNATURES, noise=0.9)
    assert segment.diagnosed(bench, asked).unexplained
    assert not found({"crosstalk": 0.4}, of_seeds=0.9).unexplained
    untried = segment.diagnosed(bench, segment.of_families(asked, ()))
    assert not untried.unexplained


def test_matchers_are_the_same_where_no_feature_is_off():
    off = 0.99 * BASE.deviation
    assert segment._same(Captured(BASE.mean + off), BASE)  # type: ignore[arg-type]
    off[SCENES - 1, FEATURES - 1] *= -1.02
    assert not segment._same(Captured(BASE.mean + off), BASE)  # type: ignore[arg-type]
