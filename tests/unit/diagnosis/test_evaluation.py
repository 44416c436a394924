"""Gap reduction on held-out scenes, and Shapley shares of effects."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import evaluation
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.likelihood import Likelihood
from tests.unit.diagnosis.made_gaps import BASE, ONES, ROOMS, FakeTable, likelihood_of, noise

THREE = {"lens_blur": 0.3, "crosstalk": 0.4, "read_noise": 0.2}


def segment_with(settings: dict[str, float]) -> Any:
    return SimpleNamespace(settings=settings, table=SimpleNamespace(segment=Segment.IMAGE))


def test_shares_are_shapley_values():
    """Shares average over all orders; each effect alone widens the gap that all close."""
    table: Any = FakeTable(together=0.5)
    likelihood = likelihood_of(THREE, 7, table=table)

    def closed(names: tuple[str, ...]) -> float:
        change = evaluation._change(table, {name: THREE[name] for name in names})
        return likelihood.size(likelihood.no_change) - likelihood.size(change)

    orders = list(itertools.permutations(THREE))
    gained = dict.fromkeys(THREE, 0.0)
    for order in orders:
        for number, name in enumerate(order):
            before = closed(order[:number]) if number else 0.0
            gained[name] += (closed(order[: number + 1]) - before) / len(orders)
    result = evaluation._shares(segment_with(THREE), table, likelihood)
    total = closed(tuple(THREE))
    assert result == pytest.approx({name: gain / total for name, gain in gained.items()})
    assert sum(result.values()) == pytest.approx(1.0)
    alone = {name: closed((name,)) / total for name in THREE}
    assert max(abs(result[name] - alone[name]) for name in THREE) > 0.2


def test_no_reduction_has_no_shares():
    likelihood = likelihood_of({}, 7)
    table: Any = FakeTable()
    assert evaluation._shares(segment_with({"veil": 1.0}), table, likelihood) == {}


def test_effects_that_need_each_other_have_no_shares():
    table: Any = FakeTable()
    likelihood = likelihood_of(THREE, 7, table=table)
    change = table.change
    table.change = lambda settings: None if [*settings] == ["crosstalk"] else change(settings)
    assert evaluation._shares(segment_with(THREE), table, likelihood) == {}


def test_before_after_and_floor_come_from_real_and_simulated_captures(
    monkeypatch: pytest.MonkeyPatch,
):
    """The floor is the residual of a simulated capture that has the accepted effects."""
    settings = {"veil": 0.5}
    table: Any = FakeTable()
    change = table.change(settings)
    real = BASE.likelihood(change + 4 * noise(7), ONES)
    simulated = BASE.likelihood(change + 2 * noise(8), ONES)
    monkeypatch.setattr(evaluation, "_likelihoods", lambda *_: (table, real, simulated))
    held_out: Any = [SimpleNamespace(against=object(), room=room) for room in ROOMS]
    result = evaluation.evaluate_reduction(held_out, settings, [segment_with(settings)])
    figure = result.figures["features of the image"]

    def mean(likelihood: Likelihood, change: dict[str, float]) -> float:
        return float(np.mean(likelihood.scene_sizes(evaluation._change(table, change))))

    before, after, floor = mean(real, {}), mean(real, settings), mean(simulated, settings)
    assert (figure.before, figure.after, figure.floor) == pytest.approx((before, after, floor))
    assert before > 2 * after > 2 * floor
    assert figure.closed_pct == pytest.approx(100 * (before - after) / (before - floor))
    assert result.shares == {"veil": 1.0}
