"""Values beyond the range of an effect that lies at its end, and candidates too weak to name."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import search, strengths
from starling.diagnosis.which.attribution import _kind
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.model import EffectModel
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.search import SearchResult
from starling.diagnosis.which.segment import SegmentResult
from tests.unit.diagnosis.made_diagnosis import NAMED, NOTHING, segment_result
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FOLDS,
    ONES,
    SIGNATURES,
    VALUES,
    FakeTable,
    candidate,
    context,
    noise,
)


class WideTable(FakeTable):
    """Effects grow beyond their range, up to the largest value that the sensor can have."""

    def __init__(self, largest: float = np.inf) -> None:
        super().__init__()
        self.largest = largest

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        if any(value > self.largest for value in settings.values()):
            return None
        rows = np.zeros_like(EFFECTS["crosstalk"].change[0])
        for name, value in settings.items():
            rows = rows + np.sqrt(value) * self.signatures[name].change[-1]
        return rows


def searched(value: float, *, largest: float = np.inf) -> SearchResult:
    """Search a gap of `crosstalk` at a value."""
    change = WideTable().change({"crosstalk": value})
    assert change is not None
    likelihood = BASE.likelihood(change + noise(9), ONES)
    fits = [fit(signature, likelihood, FOLDS) for signature in SIGNATURES]
    return search.search_effects(context(WideTable(largest), likelihood), fits, fits)


@pytest.mark.parametrize("value", [1.6, 3.0])
def test_a_value_beyond_the_range_is_identified(value: float):
    result = searched(value)
    (effect,) = result.accepted
    assert effect.fit.name == "crosstalk" and not effect.at_end
    assert effect.fit.value == pytest.approx(value, rel=0.1)


def test_a_value_inside_the_range_is_not_widened():
    (effect,) = searched(0.4).accepted
    assert effect.fit.signature.values[-1] == 1.0 and not effect.at_end


def test_a_range_is_widened_twice_at_most():
    (effect,) = searched(8.0).accepted
    assert effect.at_end and effect.fit.value == 4.0


@pytest.mark.parametrize("largest, end", [(1.0, 1.0), (2.0, 2.0)])
def test_widening_stops_where_the_sensor_refuses(largest: float, end: float):
    """A sensor at its limit is no reason against an effect."""
    (effect,) = searched(6.0, largest=largest).accepted
    assert effect.limited and not effect.at_end and effect.fit.value == end


def test_a_value_at_the_end_of_the_range_is_no_reason_if_a_larger_one_fits_worse():
    (effect,) = searched(1.0).accepted
    assert effect.fit.value == pytest.approx(1.0, rel=0.05) and not effect.at_end


def test_the_next_value_has_twice_the_departure():
    signature = EFFECTS["veil"]
    assert strengths.beyond_range(signature, 3.0) == 2.0
    assert strengths.beyond_range(signature, 2.999) is None
    assert strengths.beyond_range(signature, 0.0) is None  # The base.
    both = dataclasses.replace(candidate("veil"), base=1.0, nodes=(0.5, 1.5))
    sides = Signature(both, (0.5, 1.0, 1.5), signature.change[:3])
    assert strengths.beyond_range(sides, 0.0) == 0.0
    assert strengths.beyond_range(sides, 2.0) == 2.0


def test_nodes_that_are_not_simulated_come_before_wider_values():
    signature = EFFECTS["veil"]
    short = dataclasses.replace(signature, values=VALUES[:3], change=signature.change[:3])
    assert strengths.beyond_range(short, 2.0) == VALUES[3]


def test_a_choice_has_no_wider_range():
    choice = dataclasses.replace(candidate("median"), base="1", nodes=("3", "5"))
    signature = Signature(choice, ("1", "3", "5"), EFFECTS["veil"].change[:3])
    assert not choice.numeric and strengths.beyond_range(signature, 2.0) is None


def test_strengths_stay_when_a_signature_gets_further_values():
    likelihood = BASE.likelihood(noise(7), ONES)
    terms = (EFFECTS["veil"], EFFECTS["crosstalk"])
    model = EffectModel(terms, (2.5, 1.25), likelihood.no_change)
    wide = EFFECTS["veil"]
    extended = dataclasses.replace(
        wide,
        values=(0.0, 0.1, *VALUES[1:], 2.0),
        change=np.stack([wide.change[0], 0.5 * wide.change[1], *wide.change[1:], wide.change[-1]]),
    )
    wider = model.with_signature(extended, 0)
    assert wider.settings == pytest.approx(model.settings) and wider.places == (3.5, 1.25)
    np.testing.assert_allclose(wider.predict().change, model.predict().change)


def unexplained(result: SearchResult, gains: list[float]) -> SegmentResult:
    """Return a segment with a gap, with candidates of given gains."""
    (effect,) = NAMED.accepted
    alone = tuple(
        dataclasses.replace(effect.fit, gain=np.array([gain])) for gain in sorted(gains)[::-1]
    )
    rows = np.full_like(result.unexplained, 3.0)
    return segment_result(dataclasses.replace(result, alone=alone, unexplained=rows))


def test_the_best_candidates_are_weak_if_none_is_accepted():
    segment = unexplained(NOTHING, [5.0, 3.0, -1.0])
    assert [candidate.total for candidate in segment.weak] == [5.0, 3.0]
    many = unexplained(NOTHING, [5.0, 4.0, 3.0, 2.0])
    assert [candidate.total for candidate in many.weak] == [5.0, 4.0, 3.0]


def test_no_candidate_is_weak_beside_an_accepted_effect_or_without_a_gap():
    assert unexplained(NAMED, [5.0]).weak == ()
    segment = unexplained(NOTHING, [5.0])
    limit = segment.unexplained_size
    assert dataclasses.replace(segment, explained_below=limit).weak == ()
    assert dataclasses.replace(segment, explained_below=0.999 * limit).weak != ()


def test_the_verdict_needs_one_effect_that_is_no_surrogate():
    explained, gap = segment_result(NAMED), unexplained(NOTHING, [])
    assert _kind([], {}) == "cannot tell"
    assert _kind([explained, gap], NAMED.settings) == "effects"
    assert _kind([explained], {}) == "none of the known"  # Its effect is a surrogate.
    assert _kind([gap], {}) == "none of the known"
    limit = gap.unexplained_size
    assert _kind([dataclasses.replace(gap, explained_below=limit)], {}) == "no gap"
