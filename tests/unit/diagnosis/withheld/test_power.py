"""Power curves: what was found at each strength."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.limits import Limits
from starling.diagnosis.validation.protocol.power import LEVELS, curves, draw, levels

Make = Callable[..., Any]
FOUND = {"lens_blur": 0.3, "read_noise": 4.0, "dropped_dots": float("inf")}
LIMITS = Limits(departures={(name, 1): found for name, found in FOUND.items()}, choices={})
NOTHING = Limits(
    departures={(row.name, sign): float("inf") for row in ROWS.values() for sign in row.signs},
    choices={},
)


def test_levels_go_from_below_the_limit_to_the_end(camera: Nominal) -> None:
    """Lens blur: a quarter of 0.3 px to the end of its range; what is never found has none."""
    found = levels(camera, LIMITS)
    assert "dropped_dots" not in found
    assert found["lens_blur"][0] == pytest.approx(0.075) and found["lens_blur"][
        -1
    ] == pytest.approx(1.1)
    assert found["read_noise"][-1] == pytest.approx(32.0)  # Eight times the limit.
    for each in found.values():
        ratios = [b / a for a, b in itertools.pairwise(each)]
        assert len(each) == LEVELS and ratios == pytest.approx([ratios[0]] * (LEVELS - 1))


@given(sets=st.integers(1, 4), each=st.integers(1, 5), entropy=st.integers(0, 2**64))
def test_every_level_is_drawn_as_often(camera: Nominal, sets: int, each: int, entropy: int) -> None:
    cases = draw(camera, LIMITS, sets, each=each, entropy=entropy)
    assert [one.number for one in cases] == sorted({one.number for one in cases})
    told: dict[tuple[str, float], int] = {}
    for one in cases:
        ((name, value),) = one.settings.items()
        key = name, round(ROWS[name].departure(camera, value), 9)
        told[key] = told.get(key, 0) + 1
    asked = {(name, round(at, 9)) for name, row in levels(camera, LIMITS).items() for at in row}
    assert told == dict.fromkeys(asked, each)


def test_one_in_each_set_and_another_lot_every_time(camera: Nominal) -> None:
    one, other = draw(camera, LIMITS, 3), draw(camera, LIMITS, 3)
    assert [each.seed for each in one] != [each.seed for each in other]
    for number in range(3):
        own = [each for each in one if each.number % 3 == number]
        assert len(own) == LEVELS * len(levels(camera, LIMITS))


@pytest.mark.parametrize(
    "limits, each, words",
    [
        (LIMITS, 0, "cases must be >= 1; got 0"),
        (NOTHING, 1, "power must have effects that can be found"),
    ],
)
def test_refused_lots(camera: Nominal, limits: Limits, each: int, words: str) -> None:
    with pytest.raises(WithheldError, match=words):
        draw(camera, limits, 2, each=each)


def test_curves_by_hand(effect: Make, say: Make, answer: Make, camera: Nominal) -> None:
    """Lens blur's neutral is 0.4 px: 0.2 and 0.6 px both depart by 0.2 px."""
    right = say("effects", effect("lens_blur"))
    near = say("effects", effect("dot_blur", 1.0, "lens_blur"))
    cases = [
        answer({"lens_blur": 0.2}, near),
        answer({"lens_blur": 0.6}, say("no gap")),
        answer({"lens_blur": 1.2}, right),
        answer({"lens_blur": 1.2}, near),
        answer({"median": 5.0}, say("none of the known", effect("median", 5.0))),
    ]
    assert curves(cases, camera) == {
        "lens_blur": [
            {"departure": 0.2, "cases": 2, "alarm": 0.5, "named": 0.0, "found": 0.5},
            {"departure": 0.8, "cases": 2, "alarm": 1.0, "named": 0.5, "found": 1.0},
        ],
        "median": [{"departure": 1.0, "cases": 1, "alarm": 1.0, "named": 0.0, "found": 0.0}],
    }


def test_refused_curves(say: Make, answer: Make, camera: Nominal) -> None:
    with pytest.raises(WithheldError, match="case 3 must be a single for a power curve; got null"):
        curves([answer({}, say("no gap"), number=3)], camera)
