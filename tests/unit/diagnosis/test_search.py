"""What a search names at last: what is borne out, and of equals the more plausible."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import search
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.model import Model, simulated
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
    SHINES,
    SHINING,
    VALUES,
    FakeBench,
    WithPartner,
    candidate,
    likelihood_of,
    noise,
    searched,
    trial,
)

_IDLE = ("gamma", "prnu", "dsnu")


@pytest.mark.parametrize("share, first", [(1.0, "exposure"), (0.9, "nir_reflectance")])
def test_of_equals_the_sensor_s_own_comes_before_the_scene_s(share, first):
    """That all surfaces are other than told is less plausible; but only where the data are even."""
    whole = MADE["lens_blur"].change
    bent = np.where(np.arange(FEATURES) % 2, whole, share * whole)
    made = {
        "nir_reflectance": Signature(candidate("nir_reflectance"), VALUES, whole),
        "exposure": Signature(candidate("exposure"), VALUES, 0.5 * bent),
    }
    bench = FakeBench(made)
    (accepted,) = searched({"nir_reflectance": 0.3}, bench=bench, names=tuple(made)).accepted
    assert accepted.fit.name == first
    names = {accepted.fit.name, *(one.name for one in accepted.rivals)}
    assert names == set(made)


def test_one_effect_of_the_sensor_takes_the_place_of_one_of_the_scene_alone():
    """Two paints that one exposure imitates by halves are not that exposure twice."""
    odd = np.arange(FEATURES) % 2 == 1
    whole = MADE["lens_blur"].change
    made = {
        "nir_reflectance": Signature(candidate("nir_reflectance"), VALUES, np.where(odd, whole, 0)),
        "ambient": Signature(candidate("ambient"), VALUES, np.where(odd, 0, whole)),
        "exposure": Signature(candidate("exposure"), VALUES, 0.5 * whole),
    }
    gap = {"nir_reflectance": 0.2, "ambient": 1.0}
    found = searched(gap, bench=FakeBench(made), names=tuple(made))
    assert len(found.settings) == len(found.accepted)
    assert set(found.settings) == set(gap)


class Cancelling(FakeBench):
    """Two effects that undo each other."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        if {"veil", "crosstalk"} <= settings.keys():
            settings = {name: settings[name] for name in settings.keys() - {"veil", "crosstalk"}}
        return super().change(settings)


def test_a_pair_has_to_outdo_the_best_effect_when_simulated():
    """Half of the gap each, their sum is all of it; together they make nothing."""
    whole = MADE["lens_blur"].change
    half = np.arange(FEATURES) % 2 == 0
    made = {
        "lens_blur": Signature(candidate("lens_blur"), VALUES, 0.8 * whole),
        "veil": Signature(candidate("veil"), VALUES, np.where(half, whole, 0.0)),
        "crosstalk": Signature(candidate("crosstalk"), VALUES, np.where(half, 0.0, whole)),
    }
    bench = Cancelling(made)
    likelihood = BASE.likelihood(whole[-1] + noise(9), ONES)
    closer = [fit(one, likelihood, HELD) for one in made.values()]
    asked = trial(bench, likelihood)
    assert search._pairs(sorted(closer, key=lambda one: -one.total), asked)
    found = search.search(asked, closer, [])
    assert found.accepted[0].fit.name == "lens_blur"


def test_where_a_second_projector_stands_is_asked_before_two_effects_that_make_up_for_it():
    truth = {"second_projector": 0.6, "second_projector.x": 0.4}
    whole = SHINING.change(truth)
    assert whole is not None
    half = np.arange(FEATURES) % 2 == 0
    grown = np.array(VALUES)[:, None, None] * whole
    made = {
        SHINES.name: SHINES,
        "lens_blur": Signature(candidate("lens_blur"), VALUES, np.where(half, grown, 0.0)),
        "crosstalk": Signature(candidate("crosstalk"), VALUES, np.where(half, 0.0, grown)),
    }
    likelihood = BASE.likelihood(whole + noise(7), ONES)
    closer = sorted(
        (fit(one, likelihood, HELD) for one in made.values()), key=lambda one: -one.total
    )
    asked = trial(WithPartner(made), likelihood)
    assert closer[0].name == SHINES.name and search._pairs(closer, asked)
    found = search.search(asked, closer, [*closer, fit(IDLE, likelihood, HELD)])
    assert found.settings == pytest.approx(truth, rel=0.15)


def test_what_gains_beside_a_strong_effect_alone_is_found():
    """Alone a dozen that look like the strong one gain more than it."""
    names = [one.name for one in effects.table() if one.name not in NAMES][:14]
    strong, weak = MADE["lens_blur"], MADE["read_noise"]
    rng = np.random.default_rng(4)
    made = {"lens_blur": strong, "read_noise": weak}
    for name in names:
        bent = strong.change * (1 + 0.3 * rng.standard_normal(FEATURES))
        made[name] = Signature(candidate(name), VALUES, bent)
    bench, truth = FakeBench(made), {"lens_blur": 1.0, "read_noise": 0.05}
    likelihood = likelihood_of(truth, 9, bench=bench)
    asked = trial(bench, likelihood)
    alone = sorted((asked.fit(one) for one in made.values()), key=lambda one: -one.total)
    closer = search.worth(alone, asked.threshold)
    assert "read_noise" not in {one.name for one in closer}
    assert set(search.search(asked, closer, alone).settings) == set(truth)


class Filling(FakeBench):
    """Two effects of which one does the opposite beside the other."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        table = super().change(settings)
        if table is None or not {"lens_blur", "read_noise"} <= settings.keys():
            return table
        alone = super().change({"read_noise": settings["read_noise"]})
        assert alone is not None
        return table - 2 * alone


def test_what_two_effects_make_together_may_be_far_from_their_sum():
    """As depth that is cut off, where holes are filled."""
    shared = np.arange(FEATURES) < FEATURES // 2
    common, own = MADE["lens_blur"].change, MADE["veil"].change
    made = {
        "lens_blur": Signature(
            candidate("lens_blur"), VALUES, np.where(shared, 2.5 * common, 2.5 * own)
        ),
        "read_noise": Signature(candidate("read_noise"), VALUES, np.where(shared, common, 0.0)),
    }
    bench, truth = Filling(made), {"lens_blur": 1.0, "read_noise": 1.0}
    likelihood = likelihood_of(truth, 9, bench=bench)
    asked = trial(bench, likelihood)
    alone = sorted((asked.fit(one) for one in made.values()), key=lambda one: -one.total)
    strong = Model((made["lens_blur"],), (3.0,), likelihood.nothing).made()
    assert asked.fit(made["read_noise"], given=strong).total < asked.threshold
    found = search.search(asked, alone, alone)
    assert found.settings == pytest.approx(truth, rel=0.1)


def test_what_does_not_gain_enough_beside_the_others_is_left_out():
    for truth, left in (({"crosstalk": 0.4}, ["crosstalk"]), ({}, [])):
        likelihood = likelihood_of(truth, 7)
        terms = (MADE["crosstalk"], MADE["veil"])
        both = Model(terms, (1.67, 0.1), likelihood.nothing)
        found = search._borne_out(both, trial(FakeBench(), likelihood))
        assert list(found.settings) == left


class Overlapping(FakeBench):
    """What veil makes beside crosstalk is nearly all made by that already."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        table = super().change(settings)
        if table is None or not {"veil", "crosstalk"} <= settings.keys():
            return table
        place = float(np.interp(settings["veil"], VALUES, range(len(VALUES))))
        return table - 0.97 * self.made["veil"].at(place).change


def test_what_an_effect_gains_is_over_what_the_others_alone_make():
    """Not over their sum, which lacks what all make together."""
    bench = Overlapping()
    likelihood = likelihood_of({"crosstalk": 0.4}, 7)
    asked = trial(bench, likelihood)
    terms, sum_of = (MADE["crosstalk"], MADE["veil"]), FakeBench().change
    values = {"crosstalk": 0.4, "veil": 0.5}
    beside = Made(bench.change(values) - sum_of(values))
    both = Model(terms, (np.interp(0.4, VALUES, range(4)), 2.0), beside)
    summed = asked.fit(MADE["veil"], given=both.made(without=1))
    assert summed.total > 2 * asked.threshold > 0
    assert search._own(1, both, asked)[0].total < asked.threshold / 2
    assert list(search._borne_out(both, asked).settings) == ["crosstalk"]


class Refusing(FakeBench):
    """Has a sensor that no veil can be set in."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        return None if "veil" in settings else super().change(settings)


def test_where_the_best_cannot_be_set_the_next_is_named():
    whole = MADE["veil"].change
    like = np.where(np.arange(FEATURES) % 8, whole, 0.0)
    made = {"veil": MADE["veil"], "crosstalk": Signature(candidate("crosstalk"), VALUES, like)}
    likelihood = BASE.likelihood(whole[2] + noise(9), ONES)
    closer = sorted(
        (fit(one, likelihood, HELD) for one in made.values()), key=lambda one: -one.total
    )
    assert closer[0].name == "veil"
    found = search.search(trial(Refusing(made), likelihood), closer, [])
    assert list(found.settings) == ["crosstalk"]


def test_where_what_gains_most_in_a_place_cannot_be_set_the_next_is_put_there():
    whole = MADE["veil"].change
    like = np.where(np.arange(FEATURES) % 8, whole, 0.0)
    made = {
        **MADE,
        "dot_blur": Signature(candidate("dot_blur"), VALUES, 0.5 * whole),
        "dsnu": Signature(candidate("dsnu"), VALUES, like),
    }
    gap = whole[-1] + MADE["crosstalk"].change[2] + noise(7)
    likelihood = BASE.likelihood(gap, ONES)
    asked = trial(Refusing(made), likelihood)
    terms = (made["dot_blur"], MADE["crosstalk"])
    model = simulated(asked, Model(terms, (3.0, 2.0), likelihood.nothing))
    assert model is not None
    found = search._exchanged(model, asked, [MADE["veil"], made["dsnu"]])
    assert set(found.settings) == {"dsnu", "crosstalk"}


def test_what_does_nothing_is_no_rival_of_effects_that_strengthen_each_other():
    """What two make together is gained over either alone, whatever is put in the other's place."""
    idle = {name: Signature(candidate(name), VALUES, 0 * MADE["veil"].change) for name in _IDLE}
    bench, truth = FakeBench({**MADE, **idle}, together=1.0), {"lens_blur": 0.1, "crosstalk": 0.1}
    likelihood = likelihood_of(truth, 9, bench=bench)
    closer = [fit(one, likelihood, HELD) for one in bench.made.values()]
    found = search.search(trial(bench, likelihood, explained_below=0.6), closer, [])
    assert set(found.settings) == set(truth)
    assert not {one.name for each in found.accepted for one in each.rivals} & idle.keys()


def test_a_rival_is_what_gains_nearly_as_much_or_about_as_much_room_by_room():
    """One that gains more in all rooms but one may be as good; one that gains less in all not."""

    def gaining(name: str, *gain: float) -> Any:
        return SimpleNamespace(name=name, gain=np.array(gain), total=float(np.sum(gain)))

    asked: Any = SimpleNamespace(rooms=[str(room) for room in range(8)], threshold=12.0)
    own = gaining("own", *[20.0] * 8)
    better = gaining("better but for one room", *[21.0] * 7, -20.0)
    less = gaining("less in all", *[15.0] * 8)
    nearly = gaining("nearly as much", *[18.2] * 8)
    assert search._rivals(own, [less, better], asked) == (better,)
    assert search._rivals(own, [better, less, nearly], asked) == (nearly, better)
    assert search._rivals(own, [gaining("nothing", *[0.0] * 8)], asked) == ()
