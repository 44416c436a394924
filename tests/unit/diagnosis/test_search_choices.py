"""Choices of the search between effects that compete, interact, or cannot be set."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import search, steps, strengths
from starling.diagnosis.which.fit import Fit, fit
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.model import EffectModel
from starling.diagnosis.which.response import PredictedChange, Signature
from starling.sim import effects
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FEATURES,
    FOLDS,
    NAMES,
    ONES,
    POSITION,
    POWER,
    SECOND_PROJECTOR,
    VALUES,
    FakeTable,
    WithPartner,
    candidate,
    context,
    likelihood_of,
    noise,
    run_search,
)

_IDLE = ("gamma", "prnu", "dsnu")


def ranked(signatures: dict[str, Signature], likelihood: Likelihood) -> list[Fit]:
    fits = (fit(signature, likelihood, FOLDS) for signature in signatures.values())
    return sorted(fits, key=lambda fitted: -fitted.total)


@pytest.mark.parametrize("share, first", [(1.0, "exposure"), (0.9, "nir_reflectance")])
def test_the_sensor_is_preferred_to_the_scene_at_equal_likelihood(share: float, first: str):
    whole = EFFECTS["lens_blur"].change
    bent = np.where(np.arange(FEATURES) % 2, whole, share * whole)
    signatures = {
        "nir_reflectance": Signature(candidate("nir_reflectance"), VALUES, whole),
        "exposure": Signature(candidate("exposure"), VALUES, 0.5 * bent),
    }
    table = FakeTable(signatures)
    result = run_search({"nir_reflectance": 0.3}, table=table, names=tuple(signatures))
    (accepted,) = result.accepted
    assert accepted.fit.name == first
    names = {accepted.fit.name, *(rival.name for rival in accepted.rivals)}
    assert names == set(signatures)


def test_an_effect_of_the_sensor_replaces_only_one_effect_of_the_scene():
    """One exposure imitates half of each of two effects of the scene; it is not accepted twice."""
    odd = np.arange(FEATURES) % 2 == 1
    whole = EFFECTS["lens_blur"].change
    signatures = {
        "nir_reflectance": Signature(candidate("nir_reflectance"), VALUES, np.where(odd, whole, 0)),
        "ambient": Signature(candidate("ambient"), VALUES, np.where(odd, 0, whole)),
        "exposure": Signature(candidate("exposure"), VALUES, 0.5 * whole),
    }
    truth = {"nir_reflectance": 0.2, "ambient": 1.0}
    result = run_search(truth, table=FakeTable(signatures), names=tuple(signatures))
    assert len(result.settings) == len(result.accepted)
    assert set(result.settings) == set(truth)


@pytest.mark.parametrize("error, named", [(0.4, {"veil", "crosstalk"}), (0.1, {"lens_blur"})])
def test_two_effects_are_named_where_a_third_imitates_both(error: float, named: set[str]):
    """The third gains most alone. If it explains nearly as much, it is named, as one effect."""
    whole = 0.5 * EFFECTS["lens_blur"].change
    odd = np.arange(FEATURES) % 2 == 1
    bent = 1 + error * np.random.default_rng(1).uniform(-1, 1, FEATURES)
    signatures = {
        "veil": Signature(candidate("veil"), VALUES, np.where(odd, whole, 0.0)),
        "crosstalk": Signature(candidate("crosstalk"), VALUES, np.where(odd, 0.0, whole)),
        "lens_blur": Signature(candidate("lens_blur"), VALUES, 0.8 * bent * whole),
    }
    table = FakeTable(signatures)
    likelihood = likelihood_of({"veil": 0.5, "crosstalk": 0.5}, 9, table=table)
    singles = ranked(signatures, likelihood)
    assert singles[0].name == "lens_blur"
    model = steps.search_forward(singles, context(table, likelihood), list(signatures.values()))
    assert set(model.settings) == named


class Cancelling(FakeTable):
    """Two effects that cancel each other."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        if {"veil", "crosstalk"} <= settings.keys():
            settings = {name: settings[name] for name in settings.keys() - {"veil", "crosstalk"}}
        return super().change(settings)


def test_a_pair_must_surpass_the_best_effect_in_simulation():
    """The sum of the two halves explains the gap, but together they change nothing."""
    whole = EFFECTS["lens_blur"].change
    half = np.arange(FEATURES) % 2 == 0
    signatures = {
        "lens_blur": Signature(candidate("lens_blur"), VALUES, 0.8 * whole),
        "veil": Signature(candidate("veil"), VALUES, np.where(half, whole, 0.0)),
        "crosstalk": Signature(candidate("crosstalk"), VALUES, np.where(half, 0.0, whole)),
    }
    likelihood = BASE.likelihood(whole[-1] + noise(9), ONES)
    fits = [fit(signature, likelihood, FOLDS) for signature in signatures.values()]
    data = context(Cancelling(signatures), likelihood)
    result = search.search_effects(data, fits, [])
    assert result.accepted[0].fit.name == "lens_blur"


def test_a_further_parameter_is_tried_before_a_pair_that_imitates_it():
    truth = {"second_projector": 0.6, "second_projector.x": 0.4}
    whole = SECOND_PROJECTOR.change(truth)
    assert whole is not None
    half = np.arange(FEATURES) % 2 == 0
    change = np.array(VALUES)[:, None, None] * whole
    signatures = {
        POWER.name: POWER,
        "lens_blur": Signature(candidate("lens_blur"), VALUES, np.where(half, change, 0.0)),
        "crosstalk": Signature(candidate("crosstalk"), VALUES, np.where(half, 0.0, change)),
    }
    likelihood = BASE.likelihood(whole + noise(7), ONES)
    fits = ranked(signatures, likelihood)
    data = context(WithPartner(signatures), likelihood)
    assert fits[0].name == POWER.name
    result = search.search_effects(data, fits, [*fits, fit(POSITION, likelihood, FOLDS)])
    assert result.settings == pytest.approx(truth, rel=0.15)


def test_an_effect_that_gains_only_with_a_strong_one_is_found():
    """Alone, a dozen effects similar to the strong one gain more than it."""
    names = [row.name for row in effects.table() if row.name not in NAMES][:14]
    strong, weak = EFFECTS["lens_blur"], EFFECTS["read_noise"]
    rng = np.random.default_rng(4)
    signatures = {"lens_blur": strong, "read_noise": weak}
    for name in names:
        similar = strong.change * (1 + 0.3 * rng.standard_normal(FEATURES))
        signatures[name] = Signature(candidate(name), VALUES, similar)
    table, truth = FakeTable(signatures), {"lens_blur": 1.0, "read_noise": 0.05}
    likelihood = likelihood_of(truth, 9, table=table)
    data = context(table, likelihood)
    alone = ranked(signatures, likelihood)
    promising = strengths.worth_refining(alone, data.threshold)
    assert "read_noise" not in {fitted.name for fitted in promising}
    assert set(search.search_effects(data, promising, alone).settings) == set(truth)


class Opposing(FakeTable):
    """Two effects; with the first, the second has the opposite sign."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        rows = super().change(settings)
        if rows is None or not {"lens_blur", "read_noise"} <= settings.keys():
            return rows
        alone = super().change({"read_noise": settings["read_noise"]})
        assert alone is not None
        return rows - 2 * alone


def test_strongly_interacting_effects_are_found():
    """For example a depth limit together with hole filling."""
    shared = np.arange(FEATURES) < FEATURES // 2
    common, rest = EFFECTS["lens_blur"].change, EFFECTS["veil"].change
    signatures = {
        "lens_blur": Signature(
            candidate("lens_blur"), VALUES, np.where(shared, 2.5 * common, 2.5 * rest)
        ),
        "read_noise": Signature(candidate("read_noise"), VALUES, np.where(shared, common, 0.0)),
    }
    table, truth = Opposing(signatures), {"lens_blur": 1.0, "read_noise": 1.0}
    likelihood = likelihood_of(truth, 9, table=table)
    data = context(table, likelihood)
    alone = ranked(signatures, likelihood)
    strong = EffectModel((signatures["lens_blur"],), (3.0,), likelihood.no_change).predict()
    assert data.fit(signatures["read_noise"], background=strong).total < data.threshold
    result = search.search_effects(data, alone, alone)
    assert result.settings == pytest.approx(truth, rel=0.1)


def test_an_effect_without_sufficient_held_out_gain_is_pruned():
    for truth, remaining in (({"crosstalk": 0.4}, ["crosstalk"]), ({}, [])):
        likelihood = likelihood_of(truth, 7)
        terms = (EFFECTS["crosstalk"], EFFECTS["veil"])
        both = EffectModel(terms, (1.67, 0.1), likelihood.no_change)
        pruned, _ = steps.prune(both, context(FakeTable(), likelihood))
        assert list(pruned.settings) == remaining


class Overlapping(FakeTable):
    """With crosstalk, veil changes nearly nothing more."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        rows = super().change(settings)
        if rows is None or not {"veil", "crosstalk"} <= settings.keys():
            return rows
        place = float(np.interp(settings["veil"], VALUES, range(len(VALUES))))
        return rows - 0.97 * self.signatures["veil"].change_at(place).change


def test_a_gain_counts_from_a_simulation_without_the_effect():
    """Not from the sum without it, which still contains the interaction."""
    table = Overlapping()
    likelihood = likelihood_of({"crosstalk": 0.4}, 7)
    data = context(table, likelihood)
    terms = (EFFECTS["crosstalk"], EFFECTS["veil"])
    values = {"crosstalk": 0.4, "veil": 0.5}
    joint, added = table.change(values), FakeTable().change(values)
    assert joint is not None and added is not None
    places = (float(np.interp(0.4, VALUES, range(4))), 2.0)
    both = EffectModel(terms, places, PredictedChange(joint - added))
    summed = data.fit(EFFECTS["veil"], background=both.predict(without=1))
    assert summed.total > 2 * data.threshold > 0
    assert steps._remove(1, both, data).fit.total < data.threshold / 2
    pruned, _ = steps.prune(both, data)
    assert list(pruned.settings) == ["crosstalk"]


class Refusing(FakeTable):
    """A sensor that cannot have veil."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        return None if "veil" in settings else super().change(settings)


def test_if_the_best_effect_cannot_be_set_the_next_is_accepted():
    whole = EFFECTS["veil"].change
    similar = np.where(np.arange(FEATURES) % 8, whole, 0.0)
    signatures = {
        "veil": EFFECTS["veil"],
        "crosstalk": Signature(candidate("crosstalk"), VALUES, similar),
    }
    likelihood = BASE.likelihood(whole[2] + noise(9), ONES)
    fits = ranked(signatures, likelihood)
    assert fits[0].name == "veil"
    result = search.search_effects(context(Refusing(signatures), likelihood), fits, [])
    assert list(result.settings) == ["crosstalk"]


def test_an_idle_effect_is_no_rival_of_interacting_effects():
    """The interaction gains over each effect alone, whichever effect is in the other's place."""
    idle = {name: Signature(candidate(name), VALUES, 0 * POWER.change) for name in _IDLE}
    table, truth = (
        FakeTable({**EFFECTS, **idle}, together=1.0),
        {"lens_blur": 0.1, "crosstalk": 0.1},
    )
    likelihood = likelihood_of(truth, 9, table=table)
    fits = [fit(signature, likelihood, FOLDS) for signature in table.signatures.values()]
    result = search.search_effects(context(table, likelihood, explained_below=0.6), fits, [])
    assert set(result.settings) == set(truth)
    rivals = {rival.name for accepted in result.accepted for rival in accepted.rivals}
    assert not rivals & idle.keys()


def test_a_rival_gains_nearly_as_much():
    """A gain lower by the threshold, or by a tenth of a large gain, distinguishes a candidate."""

    def gaining(name: str, total: float) -> Any:
        return SimpleNamespace(name=name, total=total)

    data: Any = SimpleNamespace(threshold=12.0)
    current = gaining("current", 160.0)
    better, nearly, less = gaining("a", 161.0), gaining("b", 144.5), gaining("c", 143.5)
    assert search._rivals(current, [less, nearly, better], data) == (better, nearly)
    small = gaining("current", 20.0)
    assert search._rivals(small, [gaining("d", 7.5), gaining("e", 8.5)], data)[0].name == "e"
    assert len(search._rivals(small, [gaining("d", 7.5), gaining("e", 8.5)], data)) == 1
    weak = gaining("current", 8.0)
    assert search._rivals(weak, [gaining("f", 1.5), gaining("g", 2.5)], data)[0].name == "g"
    assert search._rivals(current, [gaining("nothing", 0.0)], data) == ()
