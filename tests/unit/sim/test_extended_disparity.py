"""Extended disparity: a second match at half the resolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.sim.sensor.matcher import D4XX
from starling.sim.stereo.matching import match
from tests.unit.sim.test_matching import shifted_pair


@pytest.mark.parametrize("shape", [(48, 300), (49, 301)])
@pytest.mark.parametrize("minimum_px", [0, 11])
@pytest.mark.parametrize(("shift_px", "share"), [(80, 0.97), (30, 0.0), (130, 0.0)])
def test_an_extended_search_has_twice_the_disparity(
    shape: tuple[int, int], minimum_px: int, shift_px: int, share: float
) -> None:
    """Half of the resolution shows 80 px as 40; disparities of the full search stay."""
    plain = replace(D4XX, search_px=48, min_disparity_px=minimum_px)
    extended = replace(plain, extended=True)
    assert (plain.largest_px, extended.largest_px) == (47 + minimum_px, 94 + 2 * (minimum_px // 2))
    left, right = shifted_pair(shift_px, shape)
    first, both = match(left, right, plain), match(left, right, extended)
    np.testing.assert_array_equal(both.disparity_px[first.valid], first.disparity_px[first.valid])
    np.testing.assert_array_equal(both.valid, both.reason == 0)
    np.testing.assert_array_equal(both.valid, np.isfinite(both.disparity_px))
    inner = (slice(8, -9), slice(150, -13))
    missing, near = ~first.valid[inner], both.disparity_px[inner]
    if share:
        assert (np.abs(near[missing] - shift_px) < 0.5).mean() > share
    else:
        assert not np.isfinite(near[missing]).any()
