"""How many cases a tier draws."""

from __future__ import annotations

from fractions import Fraction

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol.tier import TIERS


@pytest.mark.parametrize("number", TIERS)
def test_other_numbers_are_in_proportion_and_no_case_too_many(number: int):
    tier = TIERS[number]
    own = tier.counts.get("single") or tier.counts["unknown"]
    for asked in range(1, 400):
        counts, left_out = tier.drawn(asked)
        for count, of in (
            (left_out, tier.left_out),
            *zip(counts.values(), tier.counts.values(), strict=True),
        ):
            assert 0 <= count - Fraction(asked * of, own) < 1


def test_no_cases_are_refused():
    with pytest.raises(WithheldError, match="must be >= 1"):
        TIERS[1].drawn(0)


def test_sets_share_no_scene():
    for tier in TIERS.values():
        names = [name for number in range(tier.sets) for name in tier.names(number)]
        assert len(set(names)) == tier.sets * tier.scenes
    kinds = ("clutter", "clutter", "clutter", "tabletop")
    first = TIERS[2].first + TIERS[2].scenes
    expected = [f"{kind}:{first + number}" for number, kind in enumerate(kinds)]
    assert TIERS[2].names(1)[:4] == expected


def test_as_many_cases_are_measured_as_are_asked():
    counts = [sum(TIERS[tier].measures(case) for case in range(99)) for tier in TIERS]
    assert counts == [0, 12, 0, 0]
