"""Choice of the values at which candidates are simulated, and sums of changes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import strengths
from starling.diagnosis.which.candidates import Candidate, Segment, with_measured_node
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.null import LEAST_GAIN
from starling.diagnosis.which.response import (
    PredictedChange,
    Signature,
    simulate_signature,
    stack_changes,
)
from starling.sim import effects
from tests.unit.diagnosis.made_gaps import (
    BASE,
    FEATURES,
    FOLDS,
    ONES,
    SCENES,
    FakeTable,
    candidate,
    context,
    noise,
)
from tests.unit.diagnosis.test_table import random_effects


def test_a_signature_interpolates_its_scatter():
    """The mean change is 1.6 at all values, so 0.8 halfway from the base to the first value."""
    flicker = dataclasses.replace(candidate("flicker"), nodes=(0.5, 1.0))
    table = random_effects(Segment.IMAGE)
    signature = simulate_signature(flicker, table, (0.5, 1.0))
    scatter = table.scatter({"flicker": 0.5})
    assert signature is not None and scatter is not None
    np.testing.assert_allclose(signature.change_at(0.5).change, 0.8)
    np.testing.assert_allclose(signature.change_at(0.5).scatter, (0.5 * scatter) ** 2)


def test_changes_and_their_variances_add():
    first = PredictedChange(np.ones((2, 3)), np.full((1, 3), 0.5))
    second = PredictedChange(np.full((2, 3), 2.0))
    both = first + second
    assert (both.change == 3).all() and np.all(both.scatter == 0.5 * np.ones((1, 3)))
    stack = stack_changes([first, second])
    assert stack.change.shape == (2, 2, 3)
    assert np.shape(stack.scatter) == (2, 1, 3)
    assert (np.asarray(stack.scatter)[:, 0] == [[0.5] * 3, [0.0] * 3]).all()


def test_first_nodes_are_a_weak_and_a_strong_one_to_each_side():
    assert strengths.first_nodes(candidate("veil")) == [0.5, 1.0]
    sides = Candidate(
        name="roll",
        effect=effects.named("roll"),
        segment=Segment.IMAGE,
        base=0.0,
        nodes=(-2, -1, 1, 3),
    )
    assert strengths.first_nodes(sides) == [-2, -1, 1, 3]
    rendered = dataclasses.replace(
        sides, effect=effects.named("model_shift"), nodes=(-4, -3, -2, -1, 1, 2)
    )
    assert strengths.first_nodes(rendered) == [-3, 2]
    nodes = (16, 32, 48, 64, 80, 96, 112, 144, 160)
    searched = dataclasses.replace(
        sides,
        name="disparity_shift",
        effect=effects.named("disparity_shift"),
        base=128,
        nodes=nodes,
        whole=True,
    )
    assert strengths.first_nodes(searched) == [64, 160]
    checked = dataclasses.replace(
        sides, name="speckle_filter", effect=effects.named("speckle_filter"), base=300
    )
    checked = dataclasses.replace(checked, nodes=(0, 600, 1200, 3000), whole=True)
    assert strengths.first_nodes(checked) == [
        0,
        600,
        1200,
        3000,
    ]  # No new search.
    wide = dataclasses.replace(
        rendered, effect=effects.named("second_projector"), nodes=(0.03, 0.07, 0.16, 0.37, 0.9, 2)
    )
    assert strengths.first_nodes(wide) == [0.07, 0.9]
    assert strengths.first_nodes(dataclasses.replace(wide, nodes=(0.2, 0.4, 0.6, 0.8, 2))) == [0.6]
    heat = dataclasses.replace(
        sides, effect=effects.named("dark_current"), nodes=(1, 10, 100, 1e3, 1e4, 1e5)
    )
    assert strengths.first_nodes(heat) == [
        100,
        1e4,
        1e5,
    ]  # The end is far beyond.
    bits = dataclasses.replace(
        sides, effect=effects.named("quantisation"), base=8, nodes=(10, 12, 16), whole=True
    )
    assert strengths.first_nodes(bits) == [10, 12, 16]
    words = Candidate(
        name="hole_filling",
        effect=effects.named("hole_filling"),
        segment=Segment.DEPTH,
        base="off",
        nodes=("left", "nearest"),
    )
    assert strengths.first_nodes(words) == ["left", "nearest"]
    limits = dataclasses.replace(
        words, name="range", effect=effects.named("range"), base=0.0, nodes=(0.1, 0.3, 0.6, 1.0)
    )
    assert strengths.first_nodes(limits) == [0.3, 0.6, 1.0]  # The depth segment adds the end.
    assert strengths.first_nodes(dataclasses.replace(limits, segment=Segment.WHOLE)) == [0.3, 0.6]
    assert strengths.first_nodes(with_measured_node(limits, 0.11)) == [0.11, 0.3, 0.6, 1.0]


@pytest.mark.parametrize(
    "fitted_at, expected",
    [(-0.3, -0.4), (0.05, 0.1), (0.25, 0.3), (0.4, 0.55), (0.9, 1.5), (0.47, 0.47)],
)
def test_the_next_value_is_a_node_where_possible(fitted_at: float, expected: float):
    """Between simulated values, beyond them, or the fitted value if no node is left."""
    nodes = (-0.8, -0.4, 0.1, 0.3, 0.4, 0.55, 0.9, 1.5)
    values = (-0.8, 0.0, 0.2, 0.4, 0.9) if fitted_at != 0.47 else (0.0, 0.4, 0.55, 1.5)
    veil = dataclasses.replace(candidate("veil"), base=0.0, nodes=nodes)
    change = np.array(values)[:, None, None] * np.ones((SCENES, FEATURES))
    likelihood = BASE.likelihood(fitted_at * change[-1] / values[-1], ONES)
    fitted = fit(Signature(veil, values, change), likelihood, FOLDS)
    assert strengths._next_value(fitted) == pytest.approx(expected, abs=0.02)


def test_a_choice_has_no_further_values():
    words = ("off", "left", "nearest")
    row = effects.named("hole_filling")
    choice = Candidate(
        name=row.name, effect=row, segment=Segment.DEPTH, base="off", nodes=words[1:]
    )
    change = np.arange(3.0)[:, None, None] * np.ones((SCENES, FEATURES))
    fitted = fit(Signature(choice, words, change), BASE.likelihood(change[1], ONES), FOLDS)
    assert fitted.value == "left" and strengths._next_value(fitted) is None


class Bent(FakeTable):
    """An effect whose direction changes between its nodes."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        value = float(settings.get("veil", 0.0))
        turn = np.arange(FEATURES) < FEATURES * value
        return np.where(turn, 1.0, -1.0) * value * np.ones((SCENES, 1))


class Steep(FakeTable):
    """An effect with the square of its strength, and another direction at each strength."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        value = float(settings.get("veil", 0.0))
        turn = np.arange(FEATURES) < FEATURES * value
        return np.where(turn, 3.0, -1.0) * value**2 * np.ones((SCENES, 1))


def refined(table: Any, value: float, nodes: tuple[float, ...]) -> tuple[Signature, float, float]:
    """Refine an effect of a given strength; return signature, fitted value and additional gain."""
    change = table.change({"veil": value})
    likelihood = BASE.likelihood(change + noise(5), ONES)
    signature = simulate_signature(candidate("veil"), table, nodes)
    assert signature is not None
    data = context(table, likelihood)
    (fitted,) = strengths.refine([signature], data, likelihood.no_change)
    gain = fitted.total - fit(signature, likelihood, FOLDS).total
    return fitted.signature, float(fitted.value), gain


@pytest.mark.parametrize("value", [0.4, 0.55, 0.8])
def test_an_effect_is_simulated_until_it_fits_at_a_simulated_value(value: float):
    signature, fitted, gain = refined(Bent(), value, (0.1, 1.0))
    assert fitted == pytest.approx(value, rel=0.2) and gain > LEAST_GAIN
    assert 3 < len(signature.values) <= 3 + strengths._ROUNDS


@pytest.mark.parametrize("value", [0.55, 0.65, 0.8])
def test_both_neighbours_of_the_best_value_are_explored(value: float):
    """At 3.0 the fit is far worse than without the effect, yet the value lies between 0.5 and 3."""
    _, fitted, gain = refined(Steep(), value, (0.3, 0.5, 3.0))
    assert fitted == pytest.approx(value, rel=0.05) and gain > LEAST_GAIN


def test_an_effect_that_fits_between_near_neighbours_is_not_refined():
    signature, fitted, gain = refined(Bent(), 0.5, (0.45, 0.5, 0.55))
    assert fitted == pytest.approx(0.5, rel=0.02) and len(signature.values) == 4 and gain == 0
