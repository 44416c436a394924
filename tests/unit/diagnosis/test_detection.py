"""Detection limits of several sets of scenes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.validation.adapters import detection
from starling.diagnosis.which.candidates import Arm
from tests.unit.diagnosis.made_gaps import BASE, MADE, FakeBench, noise, screen


def test_limits_hold_in_every_set():
    """The farther one of each side, none where one set finds none, and choices that all find."""
    one = {
        "roll": {"base": 0.0, "below": -0.1, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": 0.01},
        "median": {"found": [3, 5]},
    }
    other = {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.1},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }
    assert detection.in_each([one]) == one
    assert detection.in_each([one, other]) == {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }


def on_devices(
    monkeypatch: pytest.MonkeyPatch, shown: float, *, base: float = 0.0, whole: bool = False
) -> tuple[float | None, list[float]]:
    """The limit to one side, and the values that were simulated for it on devices.

    Args:
        monkeypatch: lets signatures tell a departure of 1, and devices all from `shown` on.
        shown: of its sign.
        base: of the effect.
        whole: whether it takes whole numbers alone.
    """
    asked: list[float] = []

    def found(of: Any, value: float, *_: Any) -> bool:
        asked.append(value)
        return abs(value - base) >= abs(shown)

    start = base + (1.0 if shown > 0 else -1.0)
    monkeypatch.setattr(detection, "_found_on_devices", found)
    monkeypatch.setattr(detection.noticed, "least", lambda *_, **__: start)
    candidate = SimpleNamespace(base=base, whole=whole, nodes=(base - 20.0, base + 20.0))
    of: Any = SimpleNamespace(candidate=candidate, values=(start,))
    nothing: Any = None
    limit: Any = detection._side(of, nothing, nothing, upwards=shown > 0)
    return limit, asked


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("base", [0.0, 0.6])
@pytest.mark.parametrize("shown", [1.01, 1.2, 1.4, 1.5, 3.0, 9.9])
def test_a_limit_is_looked_for_backwards(
    shown: float, sign: int, base: float, monkeypatch: pytest.MonkeyPatch
):
    """Steps of half more are halved twice: it is at most the fourth root of 1.5 too strong."""
    limit, asked = on_devices(monkeypatch, sign * shown, base=base)
    assert limit is not None and limit in asked
    departure = sign * (limit - base)
    assert shown <= departure <= 1.5**0.25 * shown * (1 + 1e-9)
    assert len(asked) == len(set(asked))


def test_no_more_is_simulated_than_a_limit_takes(monkeypatch: pytest.MonkeyPatch):
    """What is found at once is not looked for, nor what is never; whole numbers end it early."""
    assert on_devices(monkeypatch, 0.9) == (1.0, [1.0])
    assert on_devices(monkeypatch, 30.0)[0] is None
    assert on_devices(monkeypatch, 2.0, whole=True) == (2.0, [1.0, 2.0])
    assert on_devices(monkeypatch, 4.0, whole=True) == (4.0, [1.0, 2.0, 3.0, 5.0, 4.0])


@pytest.mark.parametrize("count, found", [(4, True), (2, True), (1, False)])
def test_half_of_the_devices_have_to_show_it(
    count: int, found: bool, monkeypatch: pytest.MonkeyPatch
):
    """And the sensor of each has to be able to have it; of matcher and filters none is drawn."""
    shown = FakeBench().change({"veil": 0.5})
    assert shown is not None
    numbers = list(detection._DEVICES)

    def another(*_: Any, number: int) -> tuple[Any, Any]:
        return BASE, noise(number) + (shown if number in numbers[:count] else 0.0)

    monkeypatch.setattr(detection.null, "another", another)
    image, depth = (SimpleNamespace(arm=arm) for arm in (Arm.IMAGE, Arm.DEPTH))
    ask: Any = detection._found_on_devices
    assert ask(MADE["veil"], 0.5, image, screen()) == found
    assert ask(MADE["veil"], 0.5, depth, screen())

    def refused(*_: Any, number: int) -> tuple[Any, Any] | None:
        return None if number == numbers[-1] else another(number=numbers[0])

    monkeypatch.setattr(detection.null, "another", refused)
    assert not ask(MADE["veil"], 0.5, image, screen())
