"""Which capture tells rivals apart: groups of features count once, effort counts against it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis import diagnosis
from starling.diagnosis.which import discrimination
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.discrimination import FLOOR, TOLD, Proposal, Told

MANY = tuple(f"noise.x.{number}" for number in range(10))


def proposal(text: str, cost: float = 1) -> Proposal:
    return Proposal(text=text, cost=cost, frames=1, setups=discrimination._as_is)


def test_a_group_of_features_counts_once():
    """Ten that tell the same by three deviations count as one that does."""
    names = ("veil", *MANY)
    nothing = np.zeros((1, len(names)))
    off = np.full((1, len(names)), 3 * FLOOR)
    assert discrimination._apart((names, nothing), (names, off)) == pytest.approx(18)
    off[0, 1] = np.nan
    assert discrimination._apart((names, nothing), (names, off)) == pytest.approx(18)
    off[0, 0] = 100 * FLOOR  # One alone must not reach what is enough.
    assert discrimination._apart((names, nothing), (names, off)) == pytest.approx(9 + 16)
    assert TOLD**2 > 16
    assert discrimination._apart((("veil",), nothing[:, :1]), (names, off)) == pytest.approx(16)


def test_noise_of_a_capture_makes_it_tell_less():
    rng = np.random.default_rng(0)
    one, other = (rng.normal(mean, 1.0, (4000, 1)) for mean in (0.0, 2.0))
    assert discrimination._apart((("veil",), one), (("veil",), other)) == pytest.approx(4, rel=0.1)


def test_captures_come_in_the_order_of_what_they_tell_for_their_effort(
    monkeypatch: pytest.MonkeyPatch,
):
    """Six deviations at a switch come before twelve at three; what cannot be taken is left out."""
    squares = {"switch": 36.0, "walls": 144.0, "impossible": None, "worse": 25.0}
    monkeypatch.setattr(discrimination, "_squares", lambda *asked: squares[asked[-1].text])
    costs = {"walls": 3.0}
    menu = [proposal(text, costs.get(text, 1.0)) for text in squares]
    of: Any = None
    found = discrimination.tell_apart(of, {"veil": 0.1}, {"gain": 2.0}, Arm.IMAGE, menu=menu)
    assert [one.capture for one in found] == ["switch", "worse", "walls"]
    assert [one.deviations for one in found] == [6.0, 5.0, 12.0]
    assert all(one.rivals == ("veil", "gain") for one in found)


@pytest.mark.parametrize(
    "told, chosen",
    [
        ([("switch", 3.0), ("walls", 6.0), ("cap", 9.0)], ["walls"]),
        ([("switch", 3.0), ("walls", 4.0)], ["walls"]),
        ([], []),
    ],
)
def test_the_first_that_is_enough_is_proposed_else_what_tells_most(
    told: list[tuple[str, float]], chosen: list[str]
):
    """For every accepted effect and its first rival, the others as they were found."""
    asked: list[Any] = []

    def submit(scene: str, call: Any, *pair: Any) -> Any:
        asked.append((scene, call, *pair))
        captures = [Told(capture=text, rivals=("a", "b"), deviations=off) for text, off in told]
        return SimpleNamespace(result=lambda: captures)

    def accepted(name: str, *rivals: str) -> Any:
        rest = tuple(SimpleNamespace(name=rival, value=0.5) for rival in rivals)
        return SimpleNamespace(fit=SimpleNamespace(name=name, value=0.1), rivals=rest)

    arm: Any = SimpleNamespace(
        settings={"veil": 0.1, "gamma": 0.1},
        bench=SimpleNamespace(arm=Arm.IMAGE),
        search=SimpleNamespace(accepted=[accepted("veil", "gain", "dsnu"), accepted("gamma")]),
    )
    subjects: Any = [SimpleNamespace(name="attic")]
    crew: Any = SimpleNamespace(submit=submit)
    found = diagnosis._told([arm], subjects, crew, lambda many, _: many)
    assert [one.capture for one in found] == chosen
    one, other = {"gamma": 0.1, "veil": 0.1}, {"gamma": 0.1, "gain": 0.5}
    assert asked == [("attic", discrimination.tell_apart, one, other, Arm.IMAGE)]
