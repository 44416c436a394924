"""Detection limits of several sets of scenes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.validation.adapters import detection
from starling.diagnosis.which.candidates import Segment
from starling.patterns.errors import InputError
from tests.unit.diagnosis.made_gaps import BASE, EFFECTS, FakeTable, noise, screening


def test_limits_hold_in_every_set():
    """The weaker sensitivity counts on each side, and values of choices detected in all sets."""
    first = {
        "roll": {"base": 0.0, "below": -0.1, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": 0.01},
        "median": {"found": [3, 5]},
    }
    second = {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.1},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }
    assert detection.common_limits([first]) == first
    assert detection.common_limits([first, second]) == {
        "roll": {"base": 0.0, "below": -0.3, "above": 0.2},
        "veil": {"base": 0.0, "below": None, "above": None},
        "median": {"found": [5]},
    }


def on_devices(
    monkeypatch: pytest.MonkeyPatch, shown: float, *, base: float = 0.0, whole: bool = False
) -> tuple[float | None, list[float]]:
    """Return the limit on one side, and the values simulated for it on devices.

    Args:
        monkeypatch: makes signatures detect a departure of 1, and devices all from `shown` on.
        shown: signed departure from which devices detect the effect.
        base: base value of the effect.
        whole: whether the effect takes only whole numbers.
    """
    simulated: list[float] = []

    def detected(signature: Any, value: float, *_: Any) -> bool:
        simulated.append(value)
        return abs(value - base) >= abs(shown)

    start = base + (1.0 if shown > 0 else -1.0)
    monkeypatch.setattr(detection, "_detected_on_devices", detected)
    monkeypatch.setattr(detection.sensitivity, "detection_limit", lambda *_, **__: start)
    candidate = SimpleNamespace(base=base, whole=whole, nodes=(base - 20.0, base + 20.0))
    signature: Any = SimpleNamespace(candidate=candidate, values=(start,))
    nothing: Any = None
    limit: Any = detection._side(signature, nothing, nothing, upwards=shown > 0)
    return limit, simulated


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("base", [0.0, 0.6])
@pytest.mark.parametrize("shown", [1.01, 1.2, 1.4, 1.5, 3.0, 9.9])
def test_limit_is_refined_backwards(
    shown: float, sign: int, base: float, monkeypatch: pytest.MonkeyPatch
):
    """Two bisections of a factor of 1.5 leave a limit at most 1.5^(1/4) too strong."""
    limit, simulated = on_devices(monkeypatch, sign * shown, base=base)
    assert limit is not None and limit in simulated
    departure = sign * (limit - base)
    assert shown <= departure <= 1.5**0.25 * shown * (1 + 1e-9)
    assert len(simulated) == len(set(simulated))


def test_search_simulates_no_more_than_needed(monkeypatch: pytest.MonkeyPatch):
    """The search ends early for a detected start, an undetectable effect, or whole numbers."""
    assert on_devices(monkeypatch, 0.9) == (1.0, [1.0])
    assert on_devices(monkeypatch, 30.0)[0] is None
    assert on_devices(monkeypatch, 2.0, whole=True) == (2.0, [1.0, 2.0])
    assert on_devices(monkeypatch, 4.0, whole=True) == (4.0, [1.0, 2.0, 3.0, 5.0, 4.0])


@pytest.mark.parametrize("count, detected", [(4, True), (2, True), (1, False)])
def test_half_of_the_devices_must_detect_the_effect(
    count: int, detected: bool, monkeypatch: pytest.MonkeyPatch
):
    """The effect must be applicable on every device; matcher and filters need no devices."""
    shown = FakeTable().change({"veil": 0.5})
    assert shown is not None
    numbers = list(detection._DEVICES)

    def capture(*_: Any, number: int) -> tuple[Any, Any]:
        return BASE, noise(number) + (shown if number in numbers[:count] else 0.0)

    monkeypatch.setattr(detection.null, "simulate_capture", capture)
    image, depth = (SimpleNamespace(segment=segment) for segment in (Segment.IMAGE, Segment.DEPTH))
    ask: Any = detection._detected_on_devices
    assert ask(EFFECTS["veil"], 0.5, image, screening()) == detected
    assert ask(EFFECTS["veil"], 0.5, depth, screening())

    def refused(*_: Any, number: int) -> tuple[Any, Any]:
        if number == numbers[-1]:
            raise InputError("effects exclude each other")
        return capture(number=numbers[0])

    monkeypatch.setattr(detection.null, "simulate_capture", refused)
    assert not ask(EFFECTS["veil"], 0.5, image, screening())


def test_limits_despite_gaps_are_not_those_against_itself():
    with pytest.raises(InputError, match="against-itself must be omitted with --despite-gaps"):
        detection.detection((Path("a"),), sensor="d435", against_itself=True, despite_gaps=True)


def test_limits_despite_gaps_need_infrared_of_two_rooms(monkeypatch: pytest.MonkeyPatch):
    nothing = SimpleNamespace(scenes=[])
    monkeypatch.setattr(detection.capture, "open_set", lambda _: nothing)
    monkeypatch.setattr(detection, "split_test_rooms", lambda _: ([], []))
    sensor: Any = None
    with pytest.raises(InputError, match="captures must have infrared images of two rooms"):
        detection.limits_despite_gaps([Path("a")], sensor)
