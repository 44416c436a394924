"""Effects fitted to gaps that are made of them: strength, held-out gain, chance."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.which import null, search, strengths
from starling.diagnosis.which import segment as arm
from starling.diagnosis.which.candidates import Arm, Candidate
from starling.diagnosis.which.fit import fit, folds, places
from starling.diagnosis.which.likelihood import Likelihood, total, weights
from starling.diagnosis.which.model import Model, simulated
from starling.diagnosis.which.null import Base
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.response import Signature
from starling.sim import effects
from tests.unit.diagnosis.made_gaps import (
    BASE,
    FEATURES,
    HELD,
    IDLE,
    MADE,
    NAMES,
    ONES,
    ROOMS,
    SCENES,
    SEEDS,
    SHINES,
    SHINING,
    SIGNATURES,
    VALUES,
    FakeBench,
    candidate,
    likelihood_of,
    noise,
    screen,
    searched,
    trial,
)


def test_places_lie_between_the_values():
    one = SIGNATURES[0]
    assert one.value(1.5) == pytest.approx(0.35)
    np.testing.assert_allclose(one.at(1.5).change, 0.5 * (one.change[1] + one.change[2]))
    assert (one.at(0).change == 0).all()


def test_folds_hold_every_room_out_once():
    for count in (1, 2, 3, 8, 9):
        rooms = [str(number // 2) for number in range(2 * count)]
        held = folds(rooms)
        assert len(held) == min(4, count)
        assert (np.sum(held, axis=0) == 1).all()
        assert all(fold[2 * n] == fold[2 * n + 1] for fold in held for n in range(count))


@pytest.mark.parametrize("value", [0.1, 0.35, 0.9])
def test_strength_is_found(value):
    """Within 10 %, with 5 % noise in 320 numbers of size about one half; its interval holds it."""
    likelihood = likelihood_of({"veil": value}, 7)
    found = fit(MADE["veil"], likelihood, HELD)
    assert found.value == pytest.approx(value, rel=0.1)
    low, high = (float(end) for end in found.interval(ROOMS, level=0.9))
    assert low <= float(found.value) <= high
    assert found.total > 100
    wrong = fit(MADE["crosstalk"], likelihood, HELD)
    assert wrong.total < 0.2 * found.total


def test_what_is_fitted_to_its_base_is_not_named():
    likelihood = likelihood_of({"crosstalk": 0.4}, 7)
    terms = (MADE["crosstalk"], MADE["veil"])
    both = Model(terms, (1.67, 0.0), likelihood.nothing)
    found = search._thinned(both, trial(FakeBench(), likelihood))
    assert list(found.settings) == ["crosstalk"]
    assert found.settings["crosstalk"] == pytest.approx(0.4, rel=0.1)


def test_what_was_simulated_with_an_effect_goes_with_it():
    """A model of what is left is simulated anew, and tells what that leaves."""
    bench = FakeBench(together=0.2)
    likelihood = likelihood_of({"veil": 0.5}, 7)
    both = Model(
        (MADE["veil"], MADE["crosstalk"]), (2.0, 0.0), Made(0.2 * np.ones((SCENES, FEATURES)))
    )
    found = search._thinned(both, trial(bench, likelihood))
    assert list(found.settings) == ["veil"]
    named = bench.change(found.settings)
    np.testing.assert_allclose(found.made().change, named, atol=1e-9)


def test_whole_numbers_alone_are_tried_of_what_takes_no_other():
    veil = MADE["veil"]
    whole = dataclasses.replace(veil.candidate, nodes=(3.0, 40.0), whole=True)
    one = Signature(whole, (0.0, 3.0, 40.0), veil.change[[0, 2, 3]])
    tried = places(one, 16)
    values = [0, 1, 2, 3]
    np.testing.assert_allclose(tried[:4], np.array(values) / 3)
    at = np.interp(tried, (0, 1, 2), one.values)
    np.testing.assert_allclose(at, np.rint(at), atol=1e-9)
    assert len(tried) == 4 + 16
    found = fit(one, BASE.likelihood(one.at(2 / 3).change + noise(7), ONES), HELD)
    assert found.value == 2.0
    low, high = found.interval(ROOMS, level=0.9)
    assert (low, high) == (2.0, 2.0)


def test_a_compromise_gives_way_to_what_gains_more_beside_the_rest():
    """And to nothing where it is the truth, or where the sensor cannot have what gains more."""
    half = 0.7 * MADE["veil"].change + 0.3 * MADE["read_noise"].change
    compromise = Signature(candidate("dot_blur"), VALUES, half)
    bench: Any = FakeBench({**MADE, "dot_blur": compromise})

    def exchanged(*truths: dict[str, float]) -> tuple[Model, Model]:
        likelihood = BASE.likelihood(sum(map(bench.change, truths)) + noise(7), ONES)
        asked = trial(bench, likelihood)
        first = Model((compromise, MADE["crosstalk"]), (2.0, 1.0), likelihood.nothing)
        model = simulated(asked, first)
        assert model is not None
        return model, search._exchanged(model, asked, SIGNATURES)

    _, found = exchanged({"veil": 0.5, "crosstalk": 0.4})
    assert found.settings == pytest.approx({"veil": 0.5, "crosstalk": 0.4}, rel=0.1)
    for truths in ([{"dot_blur": 0.5, "crosstalk": 0.4}], [{"veil": 1.0}, {"crosstalk": 0.4}]):
        before, after = exchanged(*truths)
        assert after is before


def test_another_number_of_an_accepted_effect_is_found_where_more_is_left():
    truth = SHINING.change({"second_projector": 0.6, "second_projector.x": 0.4})
    assert truth is not None
    likelihood = BASE.likelihood(noise(7) + truth, ONES)
    closer = [fit(one, likelihood, HELD) for one in (SHINES, MADE["read_noise"])]
    alone = [*closer, fit(IDLE, likelihood, HELD)]
    found = search.search(trial(SHINING, likelihood), closer, alone)
    assert list(found.settings) == ["second_projector", "second_projector.x"]
    assert found.settings["second_projector.x"] == pytest.approx(0.4, abs=0.06)
    assert total(found.left, ONES) < 0.2 * likelihood.size(likelihood.nothing)
    enough = search.search(trial(SHINING, likelihood, explained_below=1e6), closer, alone)
    assert list(enough.settings) == ["second_projector"]


def test_a_number_of_an_effect_is_accepted_once_though_something_else_is_left():
    """`_completed` is asked twice of the same effect."""
    truth = SHINING.change({SHINES.name: 0.6, IDLE.name: 0.4})
    assert truth is not None
    likelihood = BASE.likelihood(noise(7) + truth, ONES)
    asked = trial(SHINING, likelihood)
    alone = [fit(one, likelihood, HELD) for one in (SHINES, IDLE)]
    model = simulated(asked, Model((SHINES,), (2.0,), likelihood.nothing))
    assert model is not None
    once = search._completed(model, asked, alone)
    assert [one.name for one in once.terms] == [SHINES.name, IDLE.name]
    assert search._completed(once, asked, alone) is once


def test_where_there_is_a_gap_an_effect_that_explains_it_has_to_gain_less():
    """Of half of the threshold on; without a gap, or where it leaves some, it needs all of it."""
    likelihood = likelihood_of({"crosstalk": 0.4}, 9)
    closer = sorted((fit(one, likelihood, HELD) for one in SIGNATURES), key=lambda one: -one.total)
    before = likelihood.size(likelihood.nothing)

    def named(*, threshold: float, below: float) -> list[str]:
        asked = dataclasses.replace(
            trial(FakeBench(), likelihood, explained_below=below), threshold=threshold
        )
        return list(search.search(asked, closer, closer).settings)

    gain = closer[0].total
    assert named(threshold=1.5 * gain, below=2.0) == ["crosstalk"]
    assert before > 2 and named(threshold=1.5 * gain, below=1.1 * before) == []
    assert named(threshold=1.5 * gain, below=0.5) == []
    assert named(threshold=2.5 * gain, below=2.0) == []


@pytest.mark.parametrize("below, rounds", [(1.5, 1), (0.0, 0)])
def test_rivals_of_stand_ins_are_not_simulated_closer(below, rounds, monkeypatch):
    """Where more is left than what is named leaves, nothing is named: rivals need not be right."""
    beside: list[float] = []

    def sharper(*arguments: Any, gained: float | None = None, **others: Any) -> Any:
        if gained is None:
            return strengths.sharper(*arguments, **others)
        beside.append(gained)
        return strengths.sharper(*arguments, gained=gained, **others)

    monkeypatch.setattr(search, "sharper", sharper)
    likelihood = likelihood_of({"veil": 0.5}, 7)
    alone = [fit(one, likelihood, HELD) for one in SIGNATURES]
    found = search.search(trial(FakeBench(), likelihood, explained_below=below), alone, alone)
    assert list(found.settings) == ["veil"] and 0 < total(found.beyond, ONES) < 1.5
    assert len(beside) == rounds


def test_the_interval_of_a_choice_holds_what_cannot_be_told_apart():
    """Nothing lies between choices, and the base that is listed first is none of them."""
    row = effects.named("hole_filling")
    words = ("off", "left", "farthest", "nearest")
    one = Candidate(name=row.name, effect=row, arm=Arm.DEPTH, base="off", nodes=words[1:])
    change = np.zeros((4, SCENES, FEATURES))
    change[1:] = 2 * np.random.default_rng(3).standard_normal((3, 1, FEATURES))
    change[2] = change[1]
    chosen = Signature(one, words, change)
    for word, ends in (("left", ("left", "farthest")), ("nearest", ("nearest", "nearest"))):
        gap = noise(9) + chosen.at(words.index(word)).change
        found = fit(chosen, BASE.likelihood(gap, ONES), HELD)
        assert found.interval(ROOMS, level=0.9) == ends
    window = effects.named("census_window")
    numbers = dataclasses.replace(one, name=window.name, effect=window, base=7.0)
    numbers = Signature(numbers, (7.0, 3.0, 5.0, 9.0), change)
    gap = noise(9) + change[1]
    found = fit(numbers, BASE.likelihood(gap, ONES), HELD)
    assert found.interval(ROOMS, level=0.9) == (3.0, 5.0)


def test_no_effect_gains_from_noise():
    gains = null.gains(BASE, SIGNATURES, ONES, HELD)
    assert gains.shape == (SEEDS,) and (gains < null.LEAST_GAIN).all()
    assert null.threshold(gains) == null.LEAST_GAIN
    assert null.threshold(np.array([50.0] * 20)) == 50
    assert null.threshold(np.empty(0)) == null.LEAST_GAIN
    assert null.size(BASE, ONES) < 1.4
    assert null.size(Base(BASE.tables[:1], BASE.floor), ONES) == 0


def test_what_the_lens_spot_makes_is_trusted_less():
    """A fifth of what goes with the spot, and all of what another estimate of a scene changes;
    what is not known of either as all else.
    """

    class Bench:
        arm = Arm.IMAGE

        def against(self) -> None:
            return None

        def simulated(self, settings: dict[str, float], *, seed: int = 0) -> np.ndarray:
            return np.zeros((2, 3))

        def another(self, settings: dict[str, float], *, number: int) -> np.ndarray:
            return self.simulated(settings)

        def change(self, settings: dict[str, float]) -> np.ndarray:
            assert settings == {"lens_blur": 0.0}
            return np.array([[0.0, 1.0, np.nan], [0.0, -2.0, 0.0]])

        def otherwise(self) -> list[np.ndarray]:
            return [np.array([[0.0, 0.0, 0.3], [np.nan, 0.0, 0.0]])]

    floor = null.base(Bench(), seeds=2).floor  # type: ignore[arg-type]
    least = null.FLOOR
    np.testing.assert_allclose(
        floor,
        [[least, np.hypot(least, 0.2), np.hypot(least, 0.3)], [least, np.hypot(least, 0.4), least]],
    )


def test_one_effect_is_named_and_one_alone():
    found = searched({"crosstalk": 0.4})
    assert list(found.settings) == ["crosstalk"]
    assert found.accepted[0].rivals == ()
    assert total(found.left, ONES) < 1.7 and total(found.beyond, ONES) < 1.5


def test_both_of_two_effects_are_named_at_their_strengths():
    found = searched({"crosstalk": 0.4, "lens_blur": 0.6})
    assert found.settings["crosstalk"] == pytest.approx(0.4, rel=0.1)
    assert found.settings["lens_blur"] == pytest.approx(0.6, rel=0.1)
    assert len(found.accepted) == 2


def test_what_two_effects_make_only_together_is_simulated():
    bench = FakeBench(together=0.5)
    found = searched({"crosstalk": 0.4, "lens_blur": 0.6}, bench=bench)
    assert set(found.settings) == {"crosstalk", "lens_blur"}
    assert total(found.beyond, ONES) < 2


def test_effects_that_exclude_each_other_are_not_named_together():
    alone = FakeBench().change({"crosstalk": 0.4})
    full = FakeBench().change({"veil": 1.0})
    assert alone is not None and full is not None
    likelihood = BASE.likelihood(alone + full + noise(9), ONES)
    closer = [fit(MADE[name], likelihood, HELD) for name in NAMES]
    found = search.search(trial(FakeBench(), likelihood), closer, [])
    assert found.settings and FakeBench().change(found.settings) is not None


def test_three_effects_are_named_one_after_the_other():
    found = searched({"crosstalk": 0.4, "lens_blur": 0.6, "read_noise": 0.3})
    assert set(found.settings) == {"crosstalk", "lens_blur", "read_noise"}


def test_of_no_gap_nothing_is_named():
    found = searched({})
    assert found.accepted == () and found.settings == {}
    assert (found.left == found.beyond).all() and total(found.left, ONES) < 1.4


def test_an_effect_is_simulated_where_it_fits_before_others_are_preferred():
    """Between its nodes it does more than a straight line; a rival's node is right by chance."""
    aside = np.random.default_rng(5).standard_normal((SCENES, FEATURES))
    rival = np.stack([value / 0.2 * MADE["veil"].at(1.5).change for value in VALUES])
    rival[1] += 0.05 * aside

    class Bent(FakeBench):
        def change(self, settings: dict[str, Any]) -> np.ndarray | None:
            table = super().change(settings)
            place = np.interp(settings.get("veil", 0), VALUES, range(len(VALUES)))
            bump = max(0.0, 1 - 2 * abs(float(place) - 1.5))
            return table if table is None else table + 0.08 * bump * aside

    bench = Bent({**MADE, "dot_blur": Signature(candidate("dot_blur"), VALUES, rival)})
    likelihood = likelihood_of({"veil": 0.35}, 9, bench=bench)
    rough = [fit(one, likelihood, HELD) for one in bench.made.values()]
    assert max(rough, key=lambda one: one.total).name == "dot_blur"
    found = searched({"veil": 0.35}, bench=bench, names=(*NAMES, "dot_blur"))
    (accepted,) = found.accepted
    assert accepted.fit.name == "veil"
    assert accepted.fit.value == pytest.approx(0.35, abs=0.03)


def test_an_effect_and_its_double_cannot_be_told_apart():
    double = Signature(candidate("dot_blur"), VALUES, MADE["lens_blur"].change * 1.3)
    bench = FakeBench({**MADE, "dot_blur": double})
    (accepted,) = searched({"lens_blur": 0.3}, bench=bench, names=(*NAMES, "dot_blur")).accepted
    names = {accepted.fit.name, *(one.name for one in accepted.rivals)}
    assert names == {"lens_blur", "dot_blur"}


def test_features_that_move_alike_share_one_vote():
    rng = np.random.default_rng(3)
    own = rng.standard_normal((30, SCENES, 3))
    moves = np.concatenate([own[..., :1]] * 5 + [own[..., 1:], 0 * own[..., :1]], axis=-1)
    change = np.concatenate([0 * moves[:1], moves])
    values = tuple(float(n) for n in range(31))
    one = Signature(candidate("veil"), values, change)
    weight = weights([one], np.full(8, 0.1))
    assert weight[:5] == pytest.approx(0.2, rel=0.05)
    assert weight[5:7] == pytest.approx(1, rel=0.1)
    assert (weights([], np.full(8, 0.1)) == 1).all()
    assert weight[7] == pytest.approx(1)  # Nothing moves it, so nothing repeats it.


def test_what_effects_that_are_not_tried_do_has_no_part_in_votes():
    """Features that one effect alone moves repeat what is left once it is not known."""
    families = {one.candidate.effect.family for one in SIGNATURES}
    weight = weights(SIGNATURES, BASE.deviation)
    whole = screen(*SIGNATURES, weight=weight, noise=null.size(BASE, weight))
    assert arm.of_families(whole, families) is whole
    rest = families - {effects.named("veil").family}
    part = arm.of_families(whole, rest)
    assert "veil" not in {one.name for one in part.rough}
    np.testing.assert_array_equal(part.weight, weights(part.rough, BASE.deviation))
    assert (part.weight != weight).any()
    assert part.noise == null.size(BASE, part.weight) and part.threshold == whole.threshold


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.integers(0, 2))
def test_a_feature_that_is_not_known_tells_nothing(gap, missing):
    deviation, ones = np.ones((1, 3)), np.ones(3)
    values = np.array([gap])
    values[0, missing] = np.nan
    likelihood = Likelihood(values, deviation, ones)
    kept = [number for number in range(3) if number != missing]
    other = Likelihood(values[:, kept], deviation[:, kept], ones[kept])
    change = np.array([[0.5, -1.0, 2.0]])
    np.testing.assert_allclose(likelihood.cost(Made(change)), other.cost(Made(change[:, kept])))
    assert likelihood.size(Made(change)) == pytest.approx(other.size(Made(change[:, kept])))


def test_an_effect_that_overshoots_closes_no_more_than_it_does():
    """What effects may be simulated wrong by is no measure of what they close."""
    gap = np.full((2, 4), 8.0)
    likelihood = Likelihood(gap, np.ones_like(gap), np.ones(4))
    for share, left in ((0.0, 64.0), (0.5, 16.0), (1.0, 0.0), (1.5, 16.0), (2.0, 64.0)):
        made = Made(share * gap)
        assert likelihood.size(made) == pytest.approx(left)
        assert likelihood.sizes(made) == pytest.approx([left, left])
        beyond = total(likelihood.beyond(made), likelihood.weight)
        assert beyond == pytest.approx(left / (1 + (0.2 * 8 * share) ** 2))
