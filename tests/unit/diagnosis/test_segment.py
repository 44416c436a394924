"""Explained gaps, and segments without any difference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.request import CAPTURED, Request
from starling.diagnosis.which import null, strengths
from starling.diagnosis.which.candidates import Candidate, Segment
from starling.diagnosis.which.segment import (
    SegmentResult,
    _no_feature_off,
    diagnose_segment,
    restrict_to_families,
    screen_effects,
)
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FEATURES,
    PARTNERED,
    POWER,
    SCENES,
    SIGNATURES,
    FakeTable,
    WithPartner,
    noise,
    screening,
)


class Captured(FakeTable):
    """A fake table with features of captures."""

    names = tuple(f"feature {number}" for number in range(FEATURES))

    def __init__(self, real: np.ndarray, segment: Segment = Segment.IMAGE) -> None:
        super().__init__()
        self.segment = segment
        self._real = real

    def rows(self, request: Request) -> np.ndarray:
        assert request == CAPTURED
        return self._real


def diagnose(
    settings: dict[str, float], *, noise_size: float, segment: Segment = Segment.IMAGE
) -> SegmentResult:
    change = FakeTable().change(settings)
    assert change is not None
    table: Any = Captured(change + noise(7), segment)
    return diagnose_segment(table, screening(*SIGNATURES, noise=noise_size))


@pytest.mark.parametrize(
    "segment, share", [(Segment.IMAGE, 0.04), (Segment.WHOLE, 0.04), (Segment.DEPTH, 0.1)]
)
@pytest.mark.parametrize("noise_size, most", [(0.2, 0.55), (0.5, 0.65), (0.9, 0.9)])
def test_a_gap_is_explained_up_to_the_noise_and_a_share_of_its_size(
    noise_size: float, most: float, segment: Segment, share: float
):
    result = diagnose({"crosstalk": 0.4}, noise_size=noise_size, segment=segment)
    before, _ = result.sizes
    assert before > 5
    assert result.explained_below == pytest.approx(most + share * before)


def test_no_effect_is_searched_below_the_noise_size():
    result = diagnose({"crosstalk": 0.4}, noise_size=0.9)
    before, _ = result.sizes
    assert result.settings and not diagnose({"crosstalk": 0.4}, noise_size=before + 1).settings


def test_a_gap_that_no_effect_makes_is_unexplained():
    """Every second feature is off by an equal amount, which no effect of the table does."""
    table: Any = Captured(noise(7) + 0.5 * (-1.0) ** np.arange(FEATURES))
    screened = screening(*SIGNATURES, noise=0.9)
    assert diagnose_segment(table, screened).unexplained
    assert not diagnose({"crosstalk": 0.4}, noise_size=0.9).unexplained
    untried = diagnose_segment(table, restrict_to_families(screened, ()))
    assert not untried.unexplained


def test_one_feature_that_is_off_is_noticed():
    off = 0.99 * BASE.deviation
    assert _no_feature_off(Captured(BASE.mean + off), BASE)  # type: ignore[arg-type]
    off[SCENES - 1, FEATURES - 1] *= -1.02
    assert not _no_feature_off(Captured(BASE.mean + off), BASE)  # type: ignore[arg-type]


@pytest.mark.parametrize(("acts", "count"), [(False, 2), (True, 3)])
def test_a_further_parameter_is_simulated_once_while_its_effect_is_off(monkeypatch, acts, count):
    """Values of the position are its nodes and the base; those of the power are unchanged."""
    monkeypatch.setattr(null, "simulate_base", lambda table: BASE)
    position = Candidate(
        name="second_projector.x",
        effect=PARTNERED,
        segment=Segment.IMAGE,
        base=0.0,
        nodes=(-0.2, -0.1, 0.1, 0.3),
    )
    kind: Any = FakeTable if acts else WithPartner
    table = kind({**EFFECTS, PARTNERED.name: POWER, position.name: POWER})
    table.segment = Segment.IMAGE
    screened = screen_effects(table, [POWER.candidate, position])
    power, placed = screened.signatures
    assert len(power.values) == len(strengths.first_nodes(POWER.candidate)) + 1
    assert len(placed.values) == count
    assert placed.change.any() == acts
