"""Effects fitted to gaps that are made of them: strength, held-out gain, chance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis import null, search
from diagnosis.candidates import Arm, Candidate
from diagnosis.fit import fit, folds
from diagnosis.likelihood import Likelihood
from diagnosis.null import Base
from diagnosis.signature import Signature
from sim import effects

SCENES, FEATURES, SEEDS = 8, 40, 6
NAMES = ("lens_blur", "veil", "crosstalk", "read_noise")


def signature(name: str, seed: int) -> Signature:
    """An effect that grows with its strength, bent, and differs a little from scene to scene."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(FEATURES) * (rng.random(FEATURES) < 0.5)
    scenes = direction * (1 + 0.2 * rng.standard_normal((SCENES, 1)))
    values = (0.0, 0.2, 0.5, 1.0)
    change = np.stack([np.sqrt(value) * scenes for value in values])
    nodes = values[1:]
    candidate = Candidate(
        name=name, effect=effects.named(name), arm=Arm.IMAGE, base=0.0, nodes=nodes
    )
    return Signature(candidate, values, change)


SIGNATURES = [signature(name, number) for number, name in enumerate(NAMES)]


def noise(seed: int) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal((SCENES, FEATURES))


BASE = Base(np.stack([noise(100 + seed) for seed in range(SEEDS)]))


class FakeBench:
    """Simulates by adding signatures."""

    arm = Arm.IMAGE

    def simulated(self, settings: dict[str, Any], *, seed: int = 0) -> np.ndarray:
        table = BASE.tables[seed].copy()
        for name, value in settings.items():
            one = SIGNATURES[NAMES.index(name)]
            place = np.interp(value, one.values, range(len(one.values)))
            table += one.at(float(place))
        return table


def reading(settings: dict[str, float], seed: int) -> np.ndarray:
    return FakeBench().simulated(settings) - BASE.tables[0] + noise(seed)


def test_places_lie_between_the_values():
    one = SIGNATURES[0]
    assert one.value(1.5) == pytest.approx(0.35)
    np.testing.assert_allclose(one.at(1.5), 0.5 * (one.change[1] + one.change[2]))
    assert (one.at(0) == 0).all()


def test_folds_hold_every_scene_out_once():
    for scenes in (1, 2, 3, 8, 9):
        held = folds(scenes)
        assert len(held) == min(4, scenes)
        assert (np.sum(held, axis=0) == 1).all()


@pytest.mark.parametrize("value", [0.1, 0.35, 0.9])
def test_strength_is_found(value):
    """Within 10 %, with 5 % noise in 320 numbers of size about one half; its interval holds it."""
    likelihood = BASE.likelihood(reading({"veil": value}, 7))
    found = fit(SIGNATURES[1], likelihood, folds(SCENES))
    assert found.value == pytest.approx(value, rel=0.1)
    low, high = found.interval(level=0.9, seed=0)
    assert low <= found.value <= high
    assert found.gain.sum() > 100
    wrong = fit(SIGNATURES[2], likelihood, folds(SCENES))
    assert wrong.gain.sum() < 0.2 * found.gain.sum()


def test_no_effect_gains_from_noise():
    gains = null.gains(BASE, SIGNATURES, folds(SCENES))
    assert gains.shape == (SEEDS,) and (gains < null.LEAST_GAIN).all()
    assert null.threshold(gains) == null.LEAST_GAIN
    assert null.threshold(np.array([50.0] * 20)) == 50


def test_one_effect_is_named_and_one_alone():
    found = _search({"crosstalk": 0.4})
    assert [one.fit.name for one in found.accepted] == ["crosstalk"]
    assert found.accepted[0].rivals == ()
    assert found.before > 3 and found.after < 1.5 and found.explained > 0.9


def test_both_of_two_effects_are_named():
    found = _search({"crosstalk": 0.4, "lens_blur": 0.6})
    assert {one.fit.name for one in found.accepted} == {"crosstalk", "lens_blur"}


def test_of_no_gap_nothing_is_named():
    found = _search({})
    assert found.accepted == () and found.before < 1.3


def _search(settings: dict[str, float]) -> search.Search:
    return search.search(
        FakeBench(),  # type: ignore[arg-type]
        BASE,
        SIGNATURES,
        folds(SCENES),
        threshold=null.LEAST_GAIN,
        real=reading(settings, 9),
    )


def test_an_effect_and_its_double_cannot_be_told_apart():
    double = Signature(
        Candidate(
            name="dot_blur",
            effect=effects.named("dot_blur"),
            arm=Arm.IMAGE,
            base=0.0,
            nodes=SIGNATURES[0].values[1:],
        ),
        SIGNATURES[0].values,
        SIGNATURES[0].change * 1.3,
    )
    found = search.search(
        FakeBench(),  # type: ignore[arg-type]
        BASE,
        [*SIGNATURES, double],
        folds(SCENES),
        threshold=null.LEAST_GAIN,
        real=reading({"lens_blur": 0.3}, 11),
    )
    (accepted,) = found.accepted
    assert {accepted.fit.name, *accepted.rivals} == {"lens_blur", "dot_blur"}


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.integers(0, 2))
def test_a_feature_that_is_not_known_tells_nothing(gap, missing):
    deviation = np.ones((1, 3))
    values = np.array([gap])
    values[0, missing] = np.nan
    likelihood = Likelihood(values, deviation)
    kept = [number for number in range(3) if number != missing]
    other = Likelihood(values[:, kept], deviation[:, kept])
    change = np.array([[0.5, -1.0, 2.0]])
    np.testing.assert_allclose(likelihood.cost(change), other.cost(change[:, kept]))
    # What an effect makes unknown counts as if it had done nothing.
    change[0, kept[0]] = np.nan
    same = change.copy()
    same[0, kept[0]] = 0
    np.testing.assert_allclose(likelihood.cost(change), likelihood.cost(same))
