"""What the base scatters: deviations, what chance gains, and the size of no gap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.which import null
from starling.diagnosis.which.null import Base
from tests.unit.diagnosis.made_gaps import BASE, HELD, MADE, ONES, SEEDS, SIGNATURES

ODD = 3  # A seed whose reading happens to look like an effect.
LIKE_VEIL = dataclasses.replace(
    BASE,
    tables=BASE.tables + (np.arange(SEEDS) == ODD)[:, None, None] * MADE["veil"].at(1.0).change,
)


def test_a_deviation_is_that_of_a_reading_less_a_mean_or_less_another():
    drawn = np.random.default_rng(0).standard_normal((8, 30, 200))
    of = Base(drawn, np.zeros((30, 200)))
    assert of.deviation.mean() == pytest.approx(np.sqrt(9 / 8), rel=0.01)
    pair = dataclasses.replace(of, against=drawn[0])
    assert pair.deviation.mean() == pytest.approx(np.sqrt(2), rel=0.01)
    floor = dataclasses.replace(of, floor=np.full((30, 200), 2.0))
    np.testing.assert_allclose(floor.deviation, np.hypot(of.deviation, 2.0))


def test_what_chance_gains_is_the_most_of_any_effect_for_each_seed():
    gains = null.gains(LIKE_VEIL, SIGNATURES, ONES, HELD)
    assert int(np.argmax(gains)) == ODD and gains[ODD] > 100
    assert np.delete(gains, ODD).max() < null.LEAST_GAIN
    assert null.threshold(gains) == gains[ODD]
    others = [one for one in SIGNATURES if one.name != "veil"]
    assert null.gains(LIKE_VEIL, others, ONES, HELD)[ODD] < 0.5 * gains[ODD]


def test_the_size_of_no_gap_is_the_largest_that_a_seed_makes():
    assert null.size(BASE, ONES) == pytest.approx(1.0, abs=0.4)
    assert null.size(LIKE_VEIL, ONES) > 5
