"""What effects make, drawn by lot or not, and at which strengths they are simulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import strengths
from starling.diagnosis.which.candidates import Arm, Candidate, with_told
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.likelihood import total
from starling.diagnosis.which.null import LEAST_GAIN
from starling.diagnosis.which.predicted import Made, stacked
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.response import signature as simulated_signature
from starling.diagnosis.which.rows import Columns
from starling.diagnosis.which.table import Bench
from starling.diagnosis.which.trial import Trial
from starling.sim import effects
from starling.sim.effects.effect import Value
from tests.unit.diagnosis.made_gaps import (
    BASE,
    FEATURES,
    HELD,
    ONES,
    SCENES,
    FakeBench,
    candidate,
    noise,
)


class Lots(Bench):
    """A base of noise, and effects that add 1 in one device, and 1 + 0.4 k in others."""

    def simulated(self, settings: Mapping[str, Value], *, seed: int = 0) -> np.ndarray:
        return noise(seed) + bool(settings)

    def another(self, settings: Mapping[str, Value], *, number: int) -> np.ndarray:
        return noise(number) + bool(settings) * (1 + 0.4 * number)


def lots(arm: Arm) -> Lots:
    return Lots((), Columns(arm=arm, names=(), ceiling=255))


def test_what_is_drawn_by_lot_is_a_mean_that_scatters():
    """Draws of 1, 1.4, 1.8, 2.2; one more differs by their variance and by that of their mean."""
    assert lots(Arm.IMAGE).change({"flicker": 0.1}) == pytest.approx(
        np.full((SCENES, FEATURES), 1.6)
    )
    scatter = lots(Arm.IMAGE).scatter({"flicker": 0.1})
    assert scatter is not None and scatter.shape == (FEATURES,)
    np.testing.assert_allclose(scatter, np.std([1, 1.4, 1.8, 2.2], ddof=1) * np.sqrt(1 + 1 / 4))
    for arm, name in ((Arm.IMAGE, "veil"), (Arm.DEPTH, "flicker")):
        assert lots(arm).change({name: 0.1}) == pytest.approx(np.ones((SCENES, FEATURES)))
        assert lots(arm).scatter({name: 0.1}) is None
    made = simulated_signature(
        dataclasses.replace(candidate("flicker"), nodes=(0.5, 1.0)), lots(Arm.IMAGE), (0.5, 1.0)
    )
    assert made is not None
    np.testing.assert_allclose(made.at(0.5).change, 0.8)
    np.testing.assert_allclose(made.at(0.5).scatter, (0.5 * scatter) ** 2)


def test_a_draw_that_another_device_has_is_explained():
    """A level of 0 +- 0.5 by the scene: as a change of none of these sizes, all is left."""
    drawn = 0.5 * np.random.default_rng(4).standard_normal((SCENES, 1))
    likelihood = BASE.likelihood(noise(3) + drawn, ONES)
    values, still = (0.0, 1.0), np.zeros((2, SCENES, FEATURES))
    scatter = np.outer(values, 0.5 * ONES)
    moving = Signature(candidate("flicker"), values, still, scatter)
    found = fit(moving, likelihood, HELD)
    assert found.total > 100 and found.value == pytest.approx(1, abs=0.4)
    left = likelihood.beyond(moving.at(1.0))
    assert total(left, ONES) < 1.5 < likelihood.size(likelihood.nothing)
    assert fit(Signature(candidate("flicker"), values, still), likelihood, HELD).total == 0


def test_what_effects_make_adds_up():
    one, other = Made(np.ones((2, 3)), np.full((1, 3), 0.5)), Made(np.full((2, 3), 2.0))
    both = one + other
    assert (both.change == 3).all() and np.all(both.scatter == 0.5 * np.ones((1, 3)))
    row = stacked([one, other])
    assert row.change.shape == (2, 2, 3)
    assert np.shape(row.scatter) == (2, 1, 3)
    assert (np.asarray(row.scatter)[:, 0] == [[0.5] * 3, [0.0] * 3]).all()


def test_first_tries_are_weak_and_strong_ones_to_each_side():
    assert strengths.coarse(candidate("veil")) == [0.5, 1.0]
    sides = Candidate(
        name="roll", effect=effects.named("roll"), arm=Arm.IMAGE, base=0.0, nodes=(-2, -1, 1, 3)
    )
    assert strengths.coarse(sides) == [-2, -1, 1, 3]
    rendered = dataclasses.replace(
        sides, effect=effects.named("model_shift"), nodes=(-4, -3, -2, -1, 1, 2)
    )
    assert strengths.coarse(rendered) == [-3, 2]
    nodes = (16, 32, 48, 64, 80, 96, 112, 144, 160)
    searched = dataclasses.replace(
        sides,
        name="disparity_shift",
        effect=effects.named("disparity_shift"),
        base=128,
        nodes=nodes,
        whole=True,
    )
    assert strengths.coarse(searched) == [64, 160]
    checked = dataclasses.replace(
        sides, name="speckle_filter", effect=effects.named("speckle_filter"), base=300
    )
    checked = dataclasses.replace(checked, nodes=(0, 600, 1200, 3000), whole=True)
    assert strengths.coarse(checked) == [0, 600, 1200, 3000]  # The pair is not searched anew.
    wide = dataclasses.replace(
        rendered, effect=effects.named("second_projector"), nodes=(0.03, 0.07, 0.16, 0.37, 0.9, 2)
    )
    assert strengths.coarse(wide) == [0.07, 0.9]
    assert strengths.coarse(dataclasses.replace(wide, nodes=(0.2, 0.4, 0.6, 0.8, 2))) == [0.6]
    heat = dataclasses.replace(
        sides, effect=effects.named("dark_current"), nodes=(1, 10, 100, 1e3, 1e4, 1e5)
    )
    assert strengths.coarse(heat) == [100, 1e4, 1e5]  # Most of the range lies beyond the fifth.
    bits = dataclasses.replace(
        sides, effect=effects.named("quantisation"), base=8, nodes=(10, 12, 16), whole=True
    )
    assert strengths.coarse(bits) == [10, 12, 16]
    words = Candidate(
        name="hole_filling",
        effect=effects.named("hole_filling"),
        arm=Arm.DEPTH,
        base="off",
        nodes=("left", "nearest"),
    )
    assert strengths.coarse(words) == ["left", "nearest"]
    limits = dataclasses.replace(
        words, name="range", effect=effects.named("range"), base=0.0, nodes=(0.1, 0.3, 0.6, 1.0)
    )
    assert strengths.coarse(limits) == [0.3, 0.6, 1.0]  # Of filters the end is tried as well.
    assert strengths.coarse(dataclasses.replace(limits, arm=Arm.WHOLE)) == [0.3, 0.6]
    assert strengths.coarse(with_told(limits, 0.11)) == [0.11, 0.3, 0.6, 1.0]


@pytest.mark.parametrize(
    "at, closer",
    [(-0.3, -0.4), (0.05, 0.1), (0.25, 0.3), (0.4, 0.55), (0.9, 1.5), (0.47, 0.47)],
)
def test_a_candidates_nodes_come_before_other_strengths(at, closer):
    """Between what is simulated, beyond it, and where none is left what fits itself."""
    nodes = (-0.8, -0.4, 0.1, 0.3, 0.4, 0.55, 0.9, 1.5)
    values = (-0.8, 0.0, 0.2, 0.4, 0.9) if at != 0.47 else (0.0, 0.4, 0.55, 1.5)
    one = dataclasses.replace(candidate("veil"), base=0.0, nodes=nodes)
    grows = np.array(values)[:, None, None] * np.ones((SCENES, FEATURES))
    found = fit(
        Signature(one, values, grows), BASE.likelihood(at * grows[-1] / values[-1], ONES), HELD
    )
    assert strengths._closer(found) == pytest.approx(closer, abs=0.02)


def test_words_are_all_simulated_already():
    words = ("off", "left", "nearest")
    row = effects.named("hole_filling")
    one = Candidate(name=row.name, effect=row, arm=Arm.DEPTH, base="off", nodes=words[1:])
    grows = np.arange(3.0)[:, None, None] * np.ones((SCENES, FEATURES))
    found = fit(Signature(one, words, grows), BASE.likelihood(grows[1], ONES), HELD)
    assert found.value == "left" and strengths._closer(found) is None


class Bent(FakeBench):
    """Between its nodes the effect points elsewhere than a straight line between them."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        value = float(settings.get("veil", 0.0))
        turn = np.arange(FEATURES) < FEATURES * value
        return np.where(turn, 1.0, -1.0) * value * np.ones((SCENES, 1))


class Steep(FakeBench):
    """The square of the strength, of another shape at each: far above it all is farther off."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        value = float(settings.get("veil", 0.0))
        turn = np.arange(FEATURES) < FEATURES * value
        return np.where(turn, 3.0, -1.0) * value**2 * np.ones((SCENES, 1))


def sharpened(bench: Any, value: float, nodes: tuple[float, ...]) -> tuple[Signature, float, float]:
    """Its signature, sharpened for a strength, where it then fits, and what it gains."""
    change = bench.change({"veil": value})
    likelihood = BASE.likelihood(change + noise(5), ONES)
    one = simulated_signature(candidate("veil"), bench, nodes)
    assert one is not None
    asked = Trial(
        bench=bench,
        likelihood=likelihood,
        folds=HELD,
        threshold=LEAST_GAIN,
        explained_below=0.0,
    )
    (found,) = strengths.sharper([one], asked, likelihood.nothing)
    return found.signature, float(found.value), found.total - fit(one, likelihood, HELD).total


@pytest.mark.parametrize("value", [0.4, 0.55, 0.8])
def test_an_effect_is_simulated_until_it_fits_where_it_is_simulated(value):
    sharp, found, gained = sharpened(Bent(), value, (0.1, 1.0))
    assert found == pytest.approx(value, rel=0.2) and gained > LEAST_GAIN
    assert 3 < len(sharp.values) <= 3 + strengths._ROUNDS


@pytest.mark.parametrize("value", [0.55, 0.65, 0.8])
def test_both_sides_of_where_an_effect_fits_are_looked_at(value):
    """At 3.0 it is far worse than none at all; yet the strength lies on that side of 0.5."""
    _, found, gained = sharpened(Steep(), value, (0.3, 0.5, 3.0))
    assert found == pytest.approx(value, rel=0.05) and gained > LEAST_GAIN


def test_what_fits_at_a_node_with_near_neighbours_is_not_simulated_again():
    sharp, found, gained = sharpened(Bent(), 0.5, (0.45, 0.5, 0.55))
    assert found == pytest.approx(0.5, rel=0.02) and len(sharp.values) == 4 and gained == 0


def test_of_a_feature_that_is_lost_nothing_is_changed():
    """What an effect makes unknown it does not explain."""
    columns = Columns(arm=Arm.IMAGE, names=("a", "b"), ceiling=255)
    rows = {(0, "[]", 0): np.array([1.0, 2.0]), (0, "[('veil', 0.5)]", 0): np.array([np.nan, 5.0])}
    bench = Bench(FakeBench.subjects[:1], columns, _kept={**rows})
    change = bench.change({"veil": 0.5})
    assert change is not None and change.tolist() == [[0.0, 3.0]]
