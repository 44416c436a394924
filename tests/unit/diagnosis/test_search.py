"""Search for the effects of constructed gaps."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import search, steps, strengths
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.likelihood import total_size
from starling.diagnosis.which.model import EffectModel, fit_and_simulate
from starling.diagnosis.which.response import PredictedChange, Signature
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FEATURES,
    FOLDS,
    NAMES,
    ONES,
    POSITION,
    POWER,
    SCENES,
    SECOND_PROJECTOR,
    SIGNATURES,
    VALUES,
    FakeTable,
    candidate,
    context,
    likelihood_of,
    noise,
    run_search,
)


def test_a_single_effect_is_found_alone():
    result = run_search({"crosstalk": 0.4})
    assert list(result.settings) == ["crosstalk"]
    assert result.accepted[0].rivals == ()
    assert total_size(result.residual, ONES) < 1.7 and total_size(result.unexplained, ONES) < 1.5


def test_two_effects_are_found_at_their_strengths():
    result = run_search({"crosstalk": 0.4, "lens_blur": 0.6})
    assert result.settings["crosstalk"] == pytest.approx(0.4, rel=0.1)
    assert result.settings["lens_blur"] == pytest.approx(0.6, rel=0.1)
    assert len(result.accepted) == 2


def test_three_effects_are_found():
    result = run_search({"crosstalk": 0.4, "lens_blur": 0.6, "read_noise": 0.3})
    assert set(result.settings) == {"crosstalk", "lens_blur", "read_noise"}


def test_no_effect_is_accepted_without_a_gap():
    result = run_search({})
    assert result.accepted == () and result.settings == {}
    assert (result.residual == result.unexplained).all()
    assert total_size(result.residual, ONES) < 1.4


def test_the_interaction_of_two_effects_is_simulated():
    table = FakeTable(together=0.5)
    result = run_search({"crosstalk": 0.4, "lens_blur": 0.6}, table=table)
    assert set(result.settings) == {"crosstalk", "lens_blur"}
    assert total_size(result.unexplained, ONES) < 2


def test_effects_that_exclude_each_other_are_not_accepted_together():
    crosstalk, veil = FakeTable().change({"crosstalk": 0.4}), FakeTable().change({"veil": 1.0})
    assert crosstalk is not None and veil is not None
    likelihood = BASE.likelihood(crosstalk + veil + noise(9), ONES)
    fits = [fit(EFFECTS[name], likelihood, FOLDS) for name in NAMES]
    result = search.search_effects(context(FakeTable(), likelihood), fits, [])
    assert result.settings and FakeTable().change(result.settings) is not None


def test_a_signature_is_simulated_where_it_fits_before_rivals_are_compared():
    """`veil` bends between its nodes; the rival has the right change at a node by chance."""
    direction = np.random.default_rng(5).standard_normal((SCENES, FEATURES))
    rival = np.stack([value / 0.2 * EFFECTS["veil"].change_at(1.5).change for value in VALUES])
    rival[1] += 0.05 * direction

    class Bent(FakeTable):
        def change(self, settings: dict[str, Any]) -> np.ndarray | None:
            rows = super().change(settings)
            place = np.interp(settings.get("veil", 0), VALUES, range(len(VALUES)))
            bump = max(0.0, 1 - 2 * abs(float(place) - 1.5))
            return rows if rows is None else rows + 0.08 * bump * direction

    table = Bent({**EFFECTS, "dot_blur": Signature(candidate("dot_blur"), VALUES, rival)})
    likelihood = likelihood_of({"veil": 0.35}, 9, table=table)
    fits = [fit(signature, likelihood, FOLDS) for signature in table.signatures.values()]
    assert max(fits, key=lambda fitted: fitted.total).name == "dot_blur"
    result = run_search({"veil": 0.35}, table=table, names=(*NAMES, "dot_blur"))
    (accepted,) = result.accepted
    assert accepted.fit.name == "veil"
    assert accepted.fit.value == pytest.approx(0.35, abs=0.03)


def test_a_proportional_effect_is_a_rival():
    double = Signature(candidate("dot_blur"), VALUES, EFFECTS["lens_blur"].change * 1.3)
    table = FakeTable({**EFFECTS, "dot_blur": double})
    result = run_search({"lens_blur": 0.3}, table=table, names=(*NAMES, "dot_blur"))
    (accepted,) = result.accepted
    names = {accepted.fit.name, *(rival.name for rival in accepted.rivals)}
    assert names == {"lens_blur", "dot_blur"}


def test_an_effect_fitted_to_its_base_is_pruned():
    likelihood = likelihood_of({"crosstalk": 0.4}, 7)
    terms = (EFFECTS["crosstalk"], EFFECTS["veil"])
    both = EffectModel(terms, (1.67, 0.0), likelihood.no_change)
    pruned, _ = steps.prune(both, context(FakeTable(), likelihood))
    assert list(pruned.settings) == ["crosstalk"]
    assert pruned.settings["crosstalk"] == pytest.approx(0.4, rel=0.1)


def test_a_pruned_effect_takes_its_interaction_with_it():
    """The remaining effects are simulated again."""
    table = FakeTable(together=0.2)
    likelihood = likelihood_of({"veil": 0.5}, 7)
    interaction = PredictedChange(0.2 * np.ones((SCENES, FEATURES)))
    both = EffectModel((EFFECTS["veil"], EFFECTS["crosstalk"]), (2.0, 0.0), interaction)
    pruned, _ = steps.prune(both, context(table, likelihood))
    assert list(pruned.settings) == ["veil"]
    alone = table.change(pruned.settings)
    assert alone is not None
    np.testing.assert_allclose(pruned.predict().change, alone, atol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.6])
def test_a_compromise_between_two_effects_is_removed_once_both_are_found(share: float):
    """Alone, the compromise gains more than each effect."""
    mixed = share * EFFECTS["veil"].change + (1 - share) * EFFECTS["crosstalk"].change
    compromise = Signature(candidate("dot_blur"), VALUES, mixed)
    table, truth = FakeTable({**EFFECTS, "dot_blur": compromise}), {"veil": 0.5, "crosstalk": 0.4}
    likelihood = likelihood_of(truth, 7, table=table)
    fits = [fit(signature, likelihood, FOLDS) for signature in table.signatures.values()]
    assert max(fits, key=lambda fitted: fitted.total).name == "dot_blur"
    result = search.search_effects(context(table, likelihood), fits, fits)
    assert result.settings == pytest.approx(truth, rel=0.1)


def test_a_further_parameter_of_an_accepted_effect_is_added_if_a_gap_remains():
    truth = SECOND_PROJECTOR.change({"second_projector": 0.6, "second_projector.x": 0.4})
    assert truth is not None
    likelihood = BASE.likelihood(noise(7) + truth, ONES)
    fits = [fit(signature, likelihood, FOLDS) for signature in (POWER, EFFECTS["read_noise"])]
    alone = [*fits, fit(POSITION, likelihood, FOLDS)]
    result = search.search_effects(context(SECOND_PROJECTOR, likelihood), fits, alone)
    assert list(result.settings) == ["second_projector", "second_projector.x"]
    assert result.settings["second_projector.x"] == pytest.approx(0.4, abs=0.06)
    assert total_size(result.residual, ONES) < 0.2 * likelihood.size(likelihood.no_change)
    explained = context(SECOND_PROJECTOR, likelihood, explained_below=1e6)
    result = search.search_effects(explained, fits, alone)
    assert list(result.settings) == ["second_projector"]


def test_a_further_parameter_is_added_once():
    truth = SECOND_PROJECTOR.change({POWER.name: 0.6, POSITION.name: 0.4})
    assert truth is not None
    likelihood = BASE.likelihood(noise(7) + truth, ONES)
    data = context(SECOND_PROJECTOR, likelihood)
    model = fit_and_simulate(data, EffectModel((POWER,), (2.0,), likelihood.no_change))
    assert model is not None
    once = steps.grow(model, data, [POWER, POSITION])
    assert [term.name for term in once.terms] == [POWER.name, POSITION.name]
    assert list(steps._parameters(once, data, [POWER, POSITION])) == []


def test_an_effect_that_explains_an_evident_gap_needs_half_of_the_threshold():
    """Without a gap, or if it leaves some, it needs the whole threshold."""
    likelihood = likelihood_of({"crosstalk": 0.4}, 9)
    fits = sorted(
        (fit(signature, likelihood, FOLDS) for signature in SIGNATURES),
        key=lambda fitted: -fitted.total,
    )
    before = likelihood.size(likelihood.no_change)

    def accepted(*, threshold: float, below: float) -> list[str]:
        data = context(FakeTable(), likelihood, explained_below=below)
        data = dataclasses.replace(data, threshold=threshold)
        return list(search.search_effects(data, fits, fits).settings)

    gain = fits[0].total
    assert accepted(threshold=1.5 * gain, below=2.0) == ["crosstalk"]
    assert before > 2 and accepted(threshold=1.5 * gain, below=1.1 * before) == []
    assert accepted(threshold=1.5 * gain, below=0.5) == []
    assert accepted(threshold=2.5 * gain, below=2.0) == []


@pytest.mark.parametrize("below", [1.5, 0.0])
def test_rivals_are_refined_with_and_without_a_remainder(
    below: float, monkeypatch: pytest.MonkeyPatch
):
    """A rival is as good only where it is simulated, also if something else remains."""
    gains: list[float] = []

    def refine(*arguments: Any, leader_gain: float | None = None, **options: Any) -> Any:
        if leader_gain is None:
            return strengths.refine(*arguments, **options)
        gains.append(leader_gain)
        return strengths.refine(*arguments, leader_gain=leader_gain, **options)

    monkeypatch.setattr(search, "refine", refine)
    likelihood = likelihood_of({"veil": 0.5}, 7)
    fits = [fit(signature, likelihood, FOLDS) for signature in SIGNATURES]
    data = context(FakeTable(), likelihood, explained_below=below)
    result = search.search_effects(data, fits, fits)
    assert list(result.settings) == ["veil"] and 0 < total_size(result.unexplained, ONES) < 1.5
    assert len(gains) == 1
