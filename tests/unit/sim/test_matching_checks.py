"""Reasons for missing disparity: too little texture, occlusion, ambiguity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.sensor.matcher import D4XX
from starling.sim.stereo import checks, opencv
from starling.sim.stereo.matching import DisparityMap, match


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


@pytest.mark.parametrize(("disparity", "accepted"), [(31, True), (0, False)])
def test_the_near_end_of_the_search_may_be_a_match(disparity: int, accepted: bool) -> None:
    scene = np.random.default_rng(0).integers(50, 150, (40, 200 + disparity)).astype(np.uint8)
    pair = scene[:, :200].copy(), scene[:, disparity:].copy()
    setting = replace(D4XX, search_px=32, checks=replace(D4XX.checks, near_end=True))
    inner = match(*pair, setting).disparity_px[8:-8, 60:-12]
    assert (inner == disparity).mean() > 0.97 if accepted else np.isnan(inner).all()


def test_support_counts_like_neighbours_inside_the_image() -> None:
    """At a corner the window holds 48 neighbours, in the middle of a side 90, inside 168."""
    near, far = np.float32(20), np.float32(10)
    disparity = np.full((40, 40), far)
    disparity[20, 12:27] = near  # One row: 12 of 168 neighbours agree.
    disparity[0, 0] = disparity[39, 20] = near
    disparity[20, 33] = np.nan
    everywhere = np.ones(disparity.shape, bool)
    refused = checks.unsupported(disparity, everywhere, share=0.375, step_px=4.0)
    wall = disparity == far
    assert refused[~wall].all() and not refused[wall].any()
    assert not checks.unsupported(disparity, everywhere, share=0.0, step_px=4.0).any()
    assert not checks.unsupported(disparity, everywhere, share=0.07, step_px=4.0)[20, 19]
    like = checks.unsupported(disparity, everywhere, share=0.375, step_px=10.0)
    assert not like[20, 12:27].any()
    edge = np.where(np.arange(40) < 20, near, far)[None].repeat(40, 0)
    assert not checks.unsupported(edge, everywhere, share=0.375, step_px=4.0).any()  # 90 of 168.
    assert checks.unsupported(edge, everywhere, share=0.54, step_px=4.0).sum() == 2 * 40


def test_pixels_whose_views_disagree_support_no_other() -> None:
    """Inside, half of 168 neighbours are on each side of a pixel's row, and 12 in it."""
    disparity = np.full((40, 40), np.float32(10))
    consistent = np.ones(disparity.shape, bool)
    consistent[:20] = False
    for share, rejected in ((78 / 168 - 1e-3, 0), (78 / 168 + 1e-3, 1)):
        refused = checks.unsupported(disparity, consistent, share=share, step_px=4.0)
        assert refused[19, 20] == rejected  # Six rows of 13 below it support it.
        assert not refused[20, 20]  # Its own row too.
        assert not refused[30].any()


def test_result_arrays_share_one_shape():
    with pytest.raises(InputError, match="must share one shape"):
        DisparityMap(
            disparity_px=np.zeros((2, 2), np.float32),
            valid=np.zeros((2, 3), bool),
            reason=np.zeros((2, 2), np.uint32),
        )
