"""Choice of a further capture that separates two effects."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import discrimination
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.discrimination import (
    FLOOR,
    SEPARATED,
    Discrimination,
    Proposal,
)

MANY = tuple(f"noise.x.{number}" for number in range(10))


def proposal(text: str, cost: float = 1) -> Proposal:
    return Proposal(text=text, cost=cost, frames=1, setups=discrimination._as_is)


def test_a_group_of_features_counts_once():
    """Ten features of one group, each off by three deviations, count as one."""
    names = ("veil", *MANY)
    nothing = np.zeros((1, len(names)))
    off = np.full((1, len(names)), 3 * FLOOR)
    assert discrimination._squared_distance((names, nothing), (names, off)) == pytest.approx(18)
    off[0, 1] = np.nan
    assert discrimination._squared_distance((names, nothing), (names, off)) == pytest.approx(18)
    off[0, 0] = 100 * FLOOR  # One group alone must not suffice.
    assert discrimination._squared_distance((names, nothing), (names, off)) == pytest.approx(9 + 16)
    assert SEPARATED**2 > 16
    assert discrimination._squared_distance(
        (("veil",), nothing[:, :1]), (names, off)
    ) == pytest.approx(16)


def test_noise_reduces_the_separation():
    rng = np.random.default_rng(0)
    first, second = (rng.normal(mean, 1.0, (4000, 1)) for mean in (0.0, 2.0))
    squares = discrimination._squared_distance((("veil",), first), (("veil",), second))
    assert squares == pytest.approx(4, rel=0.1)


def test_captures_are_ordered_by_separation_over_cost(monkeypatch: pytest.MonkeyPatch):
    """Six deviations at cost 1 precede twelve at cost 3; impossible captures are left out."""
    squares = {"switch": 36.0, "walls": 144.0, "impossible": None, "worse": 25.0}
    monkeypatch.setattr(discrimination, "_squares", lambda *arguments: squares[arguments[-1].text])
    costs = {"walls": 3.0}
    menu = [proposal(text, costs.get(text, 1.0)) for text in squares]
    scene: Any = None
    ordered = discrimination.discriminate(
        scene, {"veil": 0.1}, {"gain": 2.0}, Segment.IMAGE, menu=menu
    )
    assert [capture.capture for capture in ordered] == ["switch", "worse", "walls"]
    assert [capture.deviations for capture in ordered] == [6.0, 5.0, 12.0]
    assert all(capture.rivals == ("veil", "gain") for capture in ordered)


@pytest.mark.parametrize(
    "deviations, chosen",
    [
        ([("switch", 3.0), ("walls", 6.0), ("cap", 9.0)], ["walls"]),
        ([("switch", 3.0), ("walls", 4.0)], ["walls"]),
        ([], []),
    ],
)
def test_the_first_sufficient_capture_is_proposed_or_the_best_one(
    deviations: list[tuple[str, float]], chosen: list[str]
):
    """For each accepted effect and its first rival, with the other effects at their values."""
    jobs: list[Any] = []

    def submit(scene: str, call: Any, *pair: Any) -> Any:
        jobs.append((scene, call, *pair))
        captures = [
            Discrimination(capture=text, rivals=("a", "b"), deviations=size)
            for text, size in deviations
        ]
        return SimpleNamespace(result=lambda: captures)

    def accepted(name: str, *rivals: str) -> Any:
        rest = tuple(SimpleNamespace(name=rival, value=0.5) for rival in rivals)
        return SimpleNamespace(fit=SimpleNamespace(name=name, value=0.1), rivals=rest)

    segment: Any = SimpleNamespace(
        settings={"veil": 0.1, "gamma": 0.1},
        table=SimpleNamespace(segment=Segment.IMAGE),
        search=SimpleNamespace(accepted=[accepted("veil", "gain", "dsnu"), accepted("gamma")]),
    )
    scene_models: Any = [SimpleNamespace(name="attic")]
    pool: Any = SimpleNamespace(submit=submit)
    proposals = discrimination.propose_captures(
        [segment], scene_models, pool, lambda items, _: items
    )
    assert [proposal.capture for proposal in proposals] == chosen
    first, second = {"gamma": 0.1, "veil": 0.1}, {"gamma": 0.1, "gain": 0.5}
    assert jobs == [("attic", discrimination.discriminate, first, second, Segment.IMAGE)]
