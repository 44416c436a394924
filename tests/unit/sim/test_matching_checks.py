"""Reasons for missing disparity: too little texture, occlusion, ambiguity."""

from __future__ import annotations

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.stereo import checks, opencv
from starling.sim.stereo.matching import DisparityMap


def test_texture_is_in_codes_of_eight_bits() -> None:
    seen = np.random.default_rng(0).integers(100, 110, (40, 40)).astype(np.uint8)
    ten = seen.astype(np.uint16) * 4
    for least in (1.0, 2.9, 6.0):
        first, second = (
            checks.texture(checks.moments(image)[1], least_dn=least) for image in (seen, ten)
        )
        assert (first == second).all()
    _, variance = checks.moments(ten)
    assert not checks.texture(variance, least_dn=1.0).any()
    assert checks.texture(variance, least_dn=6.0).all()


def test_holes_of_an_occlusion_disagree_and_others_are_ambiguous() -> None:
    """Only one imager sees the region between a nearer and a farther surface."""
    hole = np.nan
    row = np.array([[10, hole, hole, hole, 14, 14, hole, 14, 10, hole, 10, 10]], np.float32)
    disagree, ambiguous = opencv._causes(row)
    assert np.flatnonzero(disagree[0]).tolist() == [1, 2, 3]
    assert np.flatnonzero(ambiguous[0]).tolist() == [6, 9]


def test_result_arrays_share_one_shape():
    with pytest.raises(InputError, match="must share one shape"):
        DisparityMap(
            disparity_px=np.zeros((2, 2), np.float32),
            valid=np.zeros((2, 3), bool),
            reason=np.zeros((2, 2), np.uint32),
        )
