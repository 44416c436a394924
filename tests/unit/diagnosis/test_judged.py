"""How far a gap closes on locked scenes, and whose share of that is whose."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import evaluation
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.likelihood import Likelihood
from tests.unit.diagnosis.made_gaps import BASE, ONES, ROOMS, FakeBench, likelihood_of, noise

THREE = {"lens_blur": 0.3, "crosstalk": 0.4, "read_noise": 0.2}


def of(settings: dict[str, float]) -> Any:
    return SimpleNamespace(settings=settings, bench=SimpleNamespace(arm=Arm.IMAGE))


def test_a_share_is_the_mean_of_what_an_effect_closes_after_those_before_it():
    """Over all orders; alone each of these widens the gap that all together close."""
    bench: Any = FakeBench(together=0.5)
    likelihood = likelihood_of(THREE, 7, bench=bench)

    def closed(names: tuple[str, ...]) -> float:
        made = evaluation._made(bench, {name: THREE[name] for name in names})
        return likelihood.size(likelihood.nothing) - likelihood.size(made)

    orders = list(itertools.permutations(THREE))
    gained = dict.fromkeys(THREE, 0.0)
    for order in orders:
        for number, name in enumerate(order):
            before = closed(order[:number]) if number else 0.0
            gained[name] += (closed(order[: number + 1]) - before) / len(orders)
    found = evaluation._shares(of(THREE), bench, likelihood)
    total = closed(tuple(THREE))
    assert found == pytest.approx({name: gain / total for name, gain in gained.items()})
    assert sum(found.values()) == pytest.approx(1.0)
    alone = {name: closed((name,)) / total for name in THREE}
    assert max(abs(found[name] - alone[name]) for name in THREE) > 0.2


def test_what_closes_nothing_has_no_shares():
    likelihood = likelihood_of({}, 7)
    bench: Any = FakeBench()
    assert evaluation._shares(of({"veil": 1.0}), bench, likelihood) == {}


def test_effects_that_can_only_be_set_together_have_no_shares():
    bench: Any = FakeBench()
    likelihood = likelihood_of(THREE, 7, bench=bench)
    change = bench.change
    bench.change = lambda settings: None if [*settings] == ["crosstalk"] else change(settings)
    assert evaluation._shares(of(THREE), bench, likelihood) == {}


def test_before_after_and_floor_are_of_real_readings_and_of_one_that_stands_for_them(
    monkeypatch: pytest.MonkeyPatch,
):
    """The floor is what the accepted effects leave of a simulated reading with them in it."""
    settings = {"veil": 0.5}
    bench: Any = FakeBench()
    change = bench.change(settings)
    real = BASE.likelihood(change + 4 * noise(7), ONES)
    other = BASE.likelihood(change + 2 * noise(8), ONES)
    monkeypatch.setattr(evaluation, "_likelihoods", lambda *_: (bench, real, other))
    locked: Any = [SimpleNamespace(against=object(), room=room) for room in ROOMS]
    found = evaluation.judged(locked, settings, [of(settings)])
    figure = found.figures["features of the image"]

    def mean(likelihood: Likelihood, made: dict[str, float]) -> float:
        return float(np.mean(likelihood.sizes(evaluation._made(bench, made))))

    before, after, floor = mean(real, {}), mean(real, settings), mean(other, settings)
    assert (figure.before, figure.after, figure.floor) == pytest.approx((before, after, floor))
    assert before > 2 * after > 2 * floor
    assert figure.closed_pct == pytest.approx(100 * (before - after) / (before - floor))
    assert found.shares == {"veil": 1.0}
