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


def held_out_segment(
    monkeypatch: pytest.MonkeyPatch, accepted: dict[str, float]
) -> tuple[evaluation.HeldOutSegment, Likelihood, Likelihood]:
    """Return a segment on held-out scenes, and the likelihoods of real and simulated captures."""
    table: Any = FakeTable()
    table.scene_models = [SimpleNamespace(against=object(), room=room) for room in ROOMS]
    change = table.change(accepted)
    real = BASE.likelihood(change + 4 * noise(7), ONES)
    capture = change + 2 * noise(8)
    monkeypatch.setattr(evaluation.null, "simulate_capture", lambda *_, **__: (BASE, capture))
    segment: Any = SimpleNamespace(settings=accepted, table=SimpleNamespace(segment=Segment.IMAGE))
    held_out = evaluation.HeldOutSegment(segment=segment, table=table, base=BASE, likelihood=real)
    return held_out, real, BASE.likelihood(capture, ONES)


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
    result = evaluation._shares(THREE, table, likelihood)
    total = closed(tuple(THREE))
    assert result == pytest.approx({name: gain / total for name, gain in gained.items()})
    assert sum(result.values()) == pytest.approx(1.0)
    alone = {name: closed((name,)) / total for name in THREE}
    assert max(abs(result[name] - alone[name]) for name in THREE) > 0.2


def test_no_reduction_has_no_shares():
    likelihood = likelihood_of({}, 7)
    table: Any = FakeTable()
    assert evaluation._shares({"veil": 1.0}, table, likelihood) == {}


def test_effects_that_need_each_other_have_no_shares():
    table: Any = FakeTable()
    likelihood = likelihood_of(THREE, 7, table=table)
    change = table.change
    table.change = lambda settings: None if [*settings] == ["crosstalk"] else change(settings)
    assert evaluation._shares(THREE, table, likelihood) == {}


def size_after(likelihood: Likelihood, settings: dict[str, float]) -> float:
    table: Any = FakeTable()
    return float(np.mean(likelihood.scene_sizes(evaluation._change(table, settings))))


def test_before_after_and_floor_come_from_real_and_simulated_captures(
    monkeypatch: pytest.MonkeyPatch,
):
    """The floor is the residual of a simulated capture that has the accepted effects."""
    settings = {"veil": 0.5}
    held_out, real, simulated = held_out_segment(monkeypatch, settings)
    result = evaluation.evaluate_reduction([held_out], settings)
    figure = result.figures["features of the image"]
    before, after = size_after(real, {}), size_after(real, settings)
    floor = size_after(simulated, settings)
    assert (figure.before, figure.after, figure.floor) == pytest.approx((before, after, floor))
    assert before > 2 * after > 2 * floor
    assert figure.closed_pct == pytest.approx(100 * (before - after) / (before - floor))
    assert result.shares == {"veil": 1.0} and result.alone == {"veil": result.figures}


def test_each_accepted_effect_is_measured_alone(monkeypatch: pytest.MonkeyPatch):
    """Surrogates too; together only the reported effects are applied."""
    accepted = {"veil": 0.5, "read_noise": 0.2}
    held_out, real, _ = held_out_segment(monkeypatch, accepted)
    both = evaluation.evaluate_reduction([held_out], accepted)
    assert set(both.alone) == set(accepted) == set(both.shares)
    for name, value in accepted.items():
        figure = both.alone[name]["features of the image"]
        assert figure.after == pytest.approx(size_after(real, {name: value}))
    together = both.figures["features of the image"]
    assert together.after == pytest.approx(size_after(real, accepted))
    single = evaluation.evaluate_reduction([held_out], {"veil": 0.5})
    assert set(single.alone) == set(accepted) and single.shares == {"veil": 1.0}
    assert single.figures == single.alone["veil"]
    none = evaluation.evaluate_reduction([held_out], {})
    assert none.figures == {} == none.shares and set(none.alone) == set(accepted)


def test_an_effect_that_the_sensor_cannot_have_alone_has_no_figures(
    monkeypatch: pytest.MonkeyPatch,
):
    accepted = {"veil": 0.5, "read_noise": 0.2}
    held_out, *_ = held_out_segment(monkeypatch, accepted)
    table: Any = held_out.table
    change = table.change
    table.change = lambda settings: None if [*settings] == ["veil"] else change(settings)
    result = evaluation.evaluate_reduction([held_out], accepted)
    assert result.alone["veil"] == {} and result.alone["read_noise"] and result.figures


def test_a_segment_selects_its_own_effects(monkeypatch: pytest.MonkeyPatch):
    held_out, *_ = held_out_segment(monkeypatch, {"veil": 0.5})
    assert held_out.select({"veil": 0.4, "median": 3.0}) == {"veil": 0.4}
