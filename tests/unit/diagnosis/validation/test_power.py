"""Power curves: detection rates at each strength."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.limits import DetectionLimits
from starling.diagnosis.validation.protocol.power import LEVELS, curves, draw, levels
from tests.unit.diagnosis.validation.made_results import make_effect, make_result, make_verdict

DEPARTURES = {"lens_blur": 0.3, "read_noise": 4.0, "dropped_dots": float("inf")}
LIMITS = DetectionLimits(
    departures={(name, 1): departure for name, departure in DEPARTURES.items()}, choices={}
)
NOTHING = DetectionLimits(
    departures={(row.name, sign): float("inf") for row in ROWS.values() for sign in row.signs},
    choices={},
)


def test_levels_go_from_below_the_limit_to_the_end(camera: Nominal) -> None:
    """Lens blur runs from 0.3 px / 4 to the end of its range. Undetectable effects are absent."""
    departures = levels(camera, LIMITS)
    assert "dropped_dots" not in departures
    assert departures["lens_blur"][0] == pytest.approx(0.075)
    assert departures["lens_blur"][-1] == pytest.approx(1.1)
    assert departures["read_noise"][-1] == pytest.approx(32.0)  # Eight times the limit.
    for steps in departures.values():
        ratios = [b / a for a, b in itertools.pairwise(steps)]
        assert len(steps) == LEVELS and ratios == pytest.approx([ratios[0]] * (LEVELS - 1))


@given(sets=st.integers(1, 4), each=st.integers(1, 5), entropy=st.integers(0, 2**64))
def test_every_level_is_drawn_as_often(camera: Nominal, sets: int, each: int, entropy: int) -> None:
    cases = draw(camera, LIMITS, sets, each=each, entropy=entropy)
    assert [case.number for case in cases] == sorted({case.number for case in cases})
    counts: dict[tuple[str, float], int] = {}
    for case in cases:
        ((name, value),) = case.settings.items()
        key = name, round(ROWS[name].departure(camera, value), 9)
        counts[key] = counts.get(key, 0) + 1
    keys = {
        (name, round(departure, 9))
        for name, departures in levels(camera, LIMITS).items()
        for departure in departures
    }
    assert counts == dict.fromkeys(keys, each)


def test_draws_differ_and_have_one_case_per_level_and_set(camera: Nominal) -> None:
    first, second = draw(camera, LIMITS, 3), draw(camera, LIMITS, 3)
    assert [case.seed for case in first] != [case.seed for case in second]
    for number in range(3):
        cases = [case for case in first if case.number % 3 == number]
        assert len(cases) == LEVELS * len(levels(camera, LIMITS))


def test_undetectable_effects_are_refused(camera: Nominal) -> None:
    with pytest.raises(WithheldError, match="power must have effects that can be detected"):
        draw(camera, NOTHING, 2)


def test_curves_by_hand(camera: Nominal) -> None:
    """The neutral of lens blur is 0.4 px: 0.2 and 0.6 px both depart by 0.2 px."""
    correct = make_verdict("effects", make_effect("lens_blur"))
    in_set = make_verdict("effects", make_effect("dot_blur", 1.0, "lens_blur"))
    cases = [
        make_result({"lens_blur": 0.2}, in_set),
        make_result({"lens_blur": 0.6}, make_verdict("no gap")),
        make_result({"lens_blur": 1.2}, correct),
        make_result({"lens_blur": 1.2}, in_set),
        make_result({"median": 5.0}, make_verdict("none of the known", make_effect("median", 5.0))),
    ]
    assert curves(cases, camera) == {
        "lens_blur": [
            {"departure": 0.2, "cases": 2, "alarm": 0.5, "named": 0.0, "found": 0.5},
            {"departure": 0.8, "cases": 2, "alarm": 1.0, "named": 0.5, "found": 1.0},
        ],
        "median": [{"departure": 1.0, "cases": 1, "alarm": 1.0, "named": 0.0, "found": 0.0}],
    }
