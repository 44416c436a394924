"""Evidence for accepted effects, and each reason for which an effect is a surrogate."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.howfar import evidence
from starling.diagnosis.howfar.evidence import (
    EffectEvidence,
    SurrogateReason,
    explained_share,
    scene_scatter,
)
from starling.diagnosis.report import sentences
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.search import EQUAL_COST, AcceptedEffect
from tests.unit.diagnosis.made_gaps import (
    FEATURES,
    ONES,
    SCENES,
    FakeTable,
    likelihood_of,
    run_search,
)

HALF = FEATURES // 2
ALIKE = np.zeros((SCENES, FEATURES))  # A remainder that does not differ between scenes.
(EFFECT,) = run_search({"crosstalk": 0.4}).accepted
ALONE = FakeTable().change({"crosstalk": EFFECT.fit.value})
assert ALONE is not None
CHANGE: np.ndarray = ALONE


class NamedTable(FakeTable):
    """A fake table whose features form two groups."""

    names = tuple(
        f"{'level' if number < HALF else 'noise'}.x.{number}" for number in range(FEATURES)
    )


def weigh(
    likelihood: Likelihood,
    effect: AcceptedEffect = EFFECT,
    *,
    like_another_make: Sequence[str] = (),
    beyond_scenes: bool = False,
    residual: np.ndarray = ALIKE,
) -> EffectEvidence:
    table: Any = NamedTable()
    segment: Any = SimpleNamespace(
        search=SimpleNamespace(accepted=(effect,), residual=residual),
        settings={effect.fit.name: effect.fit.value},
        like_another_make=frozenset(like_another_make),
        beyond_scenes=beyond_scenes,
    )
    return evidence.weigh_effects(segment, table, likelihood)[effect.fit.name]


def plain(gap: np.ndarray, weight: np.ndarray = ONES) -> Likelihood:
    """Return a likelihood without clipped deviations."""
    scale = max(float(np.abs(gap).max()), float(np.abs(CHANGE).max()))
    return Likelihood(gap, np.full(gap.shape, scale / 4), weight)


def test_a_right_effect_is_no_surrogate():
    result = weigh(likelihood_of({"crosstalk": 0.4}, 21))
    assert result.reasons == () and result.gain > 12
    assert 0.9 < result.explained <= 1 and result.improved > 10 * result.worsened


def test_an_unknown_cause_elsewhere_makes_no_surrogate():
    """Features that the effect does not change have no weight."""
    elsewhere = 8.0 * (np.abs(CHANGE).max(axis=0) < 1e-12)
    assert elsewhere.any()
    result = weigh(plain(CHANGE + elsewhere))
    assert result.reasons == () and result.explained == pytest.approx(1)


@pytest.mark.parametrize("step, reasons", [(-0.01, ()), (0.01, ("rival",))])
def test_a_better_rival_is_a_reason(step: float, reasons: tuple[str, ...]):
    """The prior may prefer an effect of the sensor by a negligible difference."""
    rival: Any = SimpleNamespace(total=EFFECT.fit.total + EQUAL_COST + step)
    result = weigh(plain(CHANGE), dataclasses.replace(EFFECT, rivals=(rival,)))
    assert result.reasons == reasons


@pytest.mark.parametrize(
    "place, limited, at_end", [(-1, False, True), (-1, True, False), (-2, False, False)]
)
def test_an_end_of_the_range_is_a_reason(place: int, limited: bool, at_end: bool):
    fitted = dataclasses.replace(EFFECT.fit, place=float(EFFECT.fit.places[place]))
    effect = dataclasses.replace(EFFECT, fit=fitted, limited=limited)
    assert effect.at_end == at_end
    change = FakeTable().change({"crosstalk": fitted.value})
    assert change is not None
    assert weigh(plain(change), effect).reasons == (("range",) if at_end else ())


def test_no_gain_on_held_out_rooms_is_a_reason():
    assert "held out" in weigh(plain(np.zeros_like(CHANGE))).reasons
    assert "held out" not in weigh(plain(CHANGE)).reasons


@pytest.mark.parametrize("name, reasons", [("crosstalk", ("another make",)), ("veil", ())])
def test_another_make_of_matcher_is_a_reason(name: str, reasons: tuple[str, ...]):
    assert weigh(plain(CHANGE), like_another_make=[name]).reasons == reasons


def test_a_gap_beyond_the_scenes_is_a_reason():
    assert weigh(plain(CHANGE), beyond_scenes=True).reasons == ("remainder",)


@pytest.mark.parametrize("step, misfit", [(0.01, False), (-0.01, True)])
def test_a_gap_that_stays_in_its_own_features_is_a_reason(step: float, misfit: bool):
    """An effect of a share `a` of the gap explains 1 - (1 - a)^2 of it."""
    explained = evidence._LEAST_EXPLAINED + step
    result = weigh(plain(CHANGE / (1 - np.sqrt(1 - explained))))
    assert result.explained == pytest.approx(explained)
    assert ("misfit" in result.reasons) == misfit


def test_features_that_differ_between_scenes_count_less():
    """The first half of the features keeps a gap of alternating sign."""
    alternating = np.where(np.arange(SCENES) % 2, 30.0, -30.0)[:, None]
    differing = ALIKE.copy()
    differing[:, :HALF] = alternating
    gap = CHANGE.copy()
    gap[:, :HALF] += np.sign(alternating) * np.abs(CHANGE).max()
    strict, lenient = weigh(plain(gap)), weigh(plain(gap), residual=differing)
    assert lenient.explained > strict.explained + 0.1


def test_the_scatter_is_the_variance_beyond_the_expected_one():
    rows = np.random.default_rng(3).normal(5.0, 3.0, (4000, 2))
    assert scene_scatter(rows) == pytest.approx([8.0, 8.0], rel=0.1)
    assert scene_scatter(rows / 3.1) == pytest.approx([0.0, 0.0], abs=0.01)  # Noise alone.
    assert scene_scatter(rows[:1]) == pytest.approx([0.0, 0.0])


def test_unknown_features_have_no_part_in_the_scatter():
    rows = np.array([[3.0, np.nan], [-3.0, np.nan], [np.nan, 2.0]])
    assert scene_scatter(rows) == pytest.approx([17.0, 0.0])


def test_what_gets_worse_is_listed_and_no_reason():
    """The second group has no gap, so that the effect makes one there."""
    gap = CHANGE.copy()
    gap[:, HALF:] = 0
    weight = ONES.copy()
    weight[HALF:] = 0.5 * (CHANGE[:, :HALF] ** 2).sum() / (CHANGE[:, HALF:] ** 2).sum()
    result = weigh(plain(gap, weight))
    assert result.worsened / result.improved == pytest.approx(0.5)
    assert set(result.reasons) <= {"misfit"}


def test_every_reason_has_words():
    assert set(sentences.REASONS) == set(get_args(SurrogateReason))


@given(share=st.floats(0, 1), seed=st.integers(0, 99))
def test_the_explained_share_lies_between_minus_1_and_1(share: float, seed: int):
    before = np.random.default_rng(seed).uniform(-5, 5, (SCENES, FEATURES))
    result = explained_share(share * before, before, (1 - share) * before, ONES)
    assert result == pytest.approx(1 - (1 - share) ** 2 if share > 1e-3 else result)
    assert 0 <= result <= 1
    assert explained_share(before, before, 0 * before, ONES) == pytest.approx(1)
    assert explained_share(before, before, before, ONES) == 0
    assert explained_share(before, 0 * before, before, ONES) == pytest.approx(-1)


def test_unknown_features_do_not_count():
    before = np.full((SCENES, FEATURES), 2.0)
    before[:, 0] = np.nan
    after = np.where(np.isnan(before), np.nan, 0.0)
    assert explained_share(np.full_like(before, 2.0), before, after, ONES) == 1
