"""Power curves: what was found at each strength."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from diagnosis.withheld.errors import WithheldError
from diagnosis.withheld.nominal import Nominal
from diagnosis.withheld.power import curves

Make = Callable[..., Any]


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
    levels = {"lens_blur": (0.8, 0.2, 1.5), "median": (1.0,)}
    assert curves(cases, camera, levels) == {
        "lens_blur": [
            {"departure": 0.2, "cases": 2, "named": 0.0, "found": 0.5},
            {"departure": 0.8, "cases": 2, "named": 0.5, "found": 1.0},
            {"departure": 1.5, "cases": 0, "named": None, "found": None},
        ],
        "median": [{"departure": 1.0, "cases": 1, "named": 0.0, "found": 0.0}],
    }


def test_refused_curves(say: Make, answer: Make, camera: Nominal) -> None:
    with pytest.raises(WithheldError, match="case 3 must be a single for a power curve; got null"):
        curves([answer({}, say("no gap"), number=3)], camera, {})
    blur = answer({"lens_blur": 0.8}, say("no gap"))
    with pytest.raises(WithheldError, match=r"levels must have one of lens_blur; got \['veil'\]"):
        curves([blur], camera, {"veil": [0.1]})
