"""Number of cases of a tier, and its scenes."""

from __future__ import annotations

from fractions import Fraction

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol.tier import TIERS


@pytest.mark.parametrize("number", TIERS)
def test_counts_scale_in_proportion_and_round_up(number: int):
    tier = TIERS[number]
    default = tier.counts.get("single") or tier.counts["unknown"]
    for singles in range(1, 400):
        counts, left_out = tier.scaled_counts(singles)
        for count, default_count in (
            (left_out, tier.left_out),
            *zip(counts.values(), tier.counts.values(), strict=True),
        ):
            assert 0 <= count - Fraction(singles * default_count, default) < 1


def test_a_count_of_zero_is_refused():
    with pytest.raises(WithheldError, match="must be >= 1"):
        TIERS[1].scaled_counts(0)


def test_sets_share_no_scene():
    for tier in TIERS.values():
        names = [name for number in range(tier.sets) for name in tier.scene_names(number)]
        assert len(set(names)) == tier.sets * tier.scenes
    kinds = ("clutter", "clutter", "clutter", "tabletop")
    first = TIERS[2].first_scene + TIERS[2].scenes
    expected = [f"{kind}:{first + number}" for number, kind in enumerate(kinds)]
    assert TIERS[2].scene_names(1)[:4] == expected


def test_own_depth_cases_are_counted():
    counts = [sum(TIERS[tier].has_own_depth(case) for case in range(99)) for tier in TIERS]
    assert counts == [0, 12, 0, 0]
