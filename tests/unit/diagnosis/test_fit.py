"""Fits of effects to gaps that they make: strengths, held-out gains, and choices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.which import null
from starling.diagnosis.which.candidates import Candidate, Segment
from starling.diagnosis.which.fit import fit, places, room_folds
from starling.diagnosis.which.likelihood import Likelihood, feature_weights, total_size
from starling.diagnosis.which.response import PredictedChange, Signature
from starling.diagnosis.which.segment import restrict_to_families
from starling.sim import effects
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FEATURES,
    FOLDS,
    ONES,
    ROOMS,
    SCENES,
    SIGNATURES,
    candidate,
    likelihood_of,
    noise,
    screening,
)


def test_positions_between_values_are_interpolated():
    signature = SIGNATURES[0]
    assert signature.value(1.5) == pytest.approx(0.35)
    middle = 0.5 * (signature.change[1] + signature.change[2])
    np.testing.assert_allclose(signature.change_at(1.5).change, middle)
    assert (signature.change_at(0).change == 0).all()


def test_folds_hold_out_each_room_once():
    for count in (1, 2, 3, 8, 9):
        rooms = [str(number // 2) for number in range(2 * count)]
        folds = room_folds(rooms)
        assert len(folds) == min(4, count)
        assert (np.sum(folds, axis=0) == 1).all()
        assert all(fold[2 * n] == fold[2 * n + 1] for fold in folds for n in range(count))


@pytest.mark.parametrize("value", [0.1, 0.35, 0.9])
def test_a_strength_is_fitted(value: float):
    """Within 10 %, with 5 % noise in 320 numbers of size about one half; its interval holds it."""
    likelihood = likelihood_of({"veil": value}, 7)
    fitted = fit(EFFECTS["veil"], likelihood, FOLDS)
    assert fitted.value == pytest.approx(value, rel=0.1)
    low, high = (float(end) for end in fitted.interval(ROOMS, level=0.9))
    assert low <= float(fitted.value) <= high
    assert fitted.total > 100
    wrong = fit(EFFECTS["crosstalk"], likelihood, FOLDS)
    assert wrong.total < 0.2 * fitted.total


def test_an_integer_parameter_is_tried_at_integers_only():
    veil = EFFECTS["veil"]
    whole = dataclasses.replace(veil.candidate, nodes=(3.0, 40.0), whole=True)
    signature = Signature(whole, (0.0, 3.0, 40.0), veil.change[[0, 2, 3]])
    tried = places(signature, 16)
    np.testing.assert_allclose(tried[:4], np.arange(4) / 3)
    values = np.interp(tried, (0, 1, 2), np.array(signature.values, float))
    np.testing.assert_allclose(values, np.rint(values), atol=1e-9)
    assert len(tried) == 4 + 16
    gap = signature.change_at(2 / 3).change + noise(7)
    fitted = fit(signature, BASE.likelihood(gap, ONES), FOLDS)
    assert fitted.value == 2.0
    low, high = fitted.interval(ROOMS, level=0.9)
    assert (low, high) == (2.0, 2.0)


def test_the_interval_of_a_choice_holds_its_equivalent_values():
    """There is nothing between choices, and the base at the first position is not included."""
    row = effects.named("hole_filling")
    words = ("off", "left", "farthest", "nearest")
    choice = Candidate(
        name=row.name, effect=row, segment=Segment.DEPTH, base="off", nodes=words[1:]
    )
    change = np.zeros((4, SCENES, FEATURES))
    change[1:] = 2 * np.random.default_rng(3).standard_normal((3, 1, FEATURES))
    change[2] = change[1]
    signature = Signature(choice, words, change)
    for word, ends in (("left", ("left", "farthest")), ("nearest", ("nearest", "nearest"))):
        gap = noise(9) + signature.change_at(words.index(word)).change
        fitted = fit(signature, BASE.likelihood(gap, ONES), FOLDS)
        assert fitted.interval(ROOMS, level=0.9) == ends
    window = effects.named("census_window")
    choice = dataclasses.replace(choice, name=window.name, effect=window, base=7.0)
    signature = Signature(choice, (7.0, 3.0, 5.0, 9.0), change)
    gap = noise(9) + change[1]
    fitted = fit(signature, BASE.likelihood(gap, ONES), FOLDS)
    assert fitted.interval(ROOMS, level=0.9) == (3.0, 5.0)


def test_a_random_change_explains_a_different_realisation():
    """Each scene has a level of 0 +- 0.5, which a fixed change would leave unexplained."""
    levels = 0.5 * np.random.default_rng(4).standard_normal((SCENES, 1))
    likelihood = BASE.likelihood(noise(3) + levels, ONES)
    values, change = (0.0, 1.0), np.zeros((2, SCENES, FEATURES))
    random = Signature(candidate("flicker"), values, change, np.outer(values, 0.5 * ONES))
    fitted = fit(random, likelihood, FOLDS)
    assert fitted.total > 100 and fitted.value == pytest.approx(1, abs=0.4)
    unexplained = likelihood.unexplained(random.change_at(1.0))
    assert total_size(unexplained, ONES) < 1.5 < likelihood.size(likelihood.no_change)
    fixed = Signature(candidate("flicker"), values, change)
    assert fit(fixed, likelihood, FOLDS).total == 0


def test_features_that_change_together_share_one_weight():
    rng = np.random.default_rng(3)
    independent = rng.standard_normal((30, SCENES, 3))
    changes = np.concatenate(
        [independent[..., :1]] * 5 + [independent[..., 1:], 0 * independent[..., :1]], axis=-1
    )
    change = np.concatenate([0 * changes[:1], changes])
    values = tuple(float(n) for n in range(31))
    signature = Signature(candidate("veil"), values, change)
    weight = feature_weights([signature], np.full(8, 0.1))
    assert weight[:5] == pytest.approx(0.2, rel=0.05)
    assert weight[5:7] == pytest.approx(1, rel=0.1)
    assert (feature_weights([], np.full(8, 0.1)) == 1).all()
    assert weight[7] == pytest.approx(1)  # Nothing changes it, so nothing repeats it.


def test_effects_that_are_not_tried_do_not_influence_feature_weights():
    """Without an effect, the features that only it changes repeat the constant ones."""
    families = {signature.candidate.effect.family for signature in SIGNATURES}
    weight = feature_weights(SIGNATURES, BASE.deviation)
    whole = screening(*SIGNATURES, weight=weight, noise=null.noise_size(BASE, weight))
    assert restrict_to_families(whole, families) is whole
    rest = families - {effects.named("veil").family}
    part = restrict_to_families(whole, rest)
    assert "veil" not in {signature.name for signature in part.signatures}
    expected = feature_weights(part.signatures, BASE.deviation)
    np.testing.assert_array_equal(part.weight, expected)
    assert (part.weight != weight).any()
    assert part.noise == null.noise_size(BASE, part.weight) and part.threshold == whole.threshold


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.integers(0, 2))
def test_an_unknown_feature_has_no_influence(gap: list[float], missing: int):
    deviation, ones = np.ones((1, 3)), np.ones(3)
    values = np.array([gap])
    values[0, missing] = np.nan
    likelihood = Likelihood(values, deviation, ones)
    known = [number for number in range(3) if number != missing]
    without = Likelihood(values[:, known], deviation[:, known], ones[known])
    change = np.array([[0.5, -1.0, 2.0]])
    full, part = PredictedChange(change), PredictedChange(change[:, known])
    np.testing.assert_allclose(likelihood.cost(full), without.cost(part))
    assert likelihood.size(full) == pytest.approx(without.size(part))


def test_model_error_of_effects_does_not_reduce_the_size_of_a_gap():
    gap = np.full((2, 4), 8.0)
    likelihood = Likelihood(gap, np.ones_like(gap), np.ones(4))
    for share, size in ((0.0, 64.0), (0.5, 16.0), (1.0, 0.0), (1.5, 16.0), (2.0, 64.0)):
        predicted = PredictedChange(share * gap)
        assert likelihood.size(predicted) == pytest.approx(size)
        assert likelihood.scene_sizes(predicted) == pytest.approx([size, size])
        unexplained = total_size(likelihood.unexplained(predicted), likelihood.weight)
        assert unexplained == pytest.approx(size / (1 + (0.2 * 8 * share) ** 2))
