"""Matchers of other makes: common algorithms with their usual settings."""

from __future__ import annotations

import dataclasses

from starling.sim.sensor.matcher import (
    FAST,
    OAK,
    Block,
    CensusSemiGlobal,
    Checks,
    Matcher,
    Refinement,
    SemiGlobalBlock,
)

# simsense in SAPIEN 3, sapien/sensor/stereodepth.py: census and block of 7x7, penalties 8 and 32,
# uniqueness 15 %, left-right 1 px, median 3 px. Here the census compares a chequerboard, also 24
# pairs, and paths come from five directions.
SAPIEN = Matcher(
    engine=CensusSemiGlobal(
        census_px=7,
        presmooth_px=0.0,
        tolerance_dn=0.0,
        difference_weight=0.0,
        support_px=7,
        arm_step_dn=255.0,
        small_penalty=8.0,
        large_penalty=32.0,
    ),
    refinement=Refinement(median_px=3),
    checks=Checks(uniqueness=15.0, left_right_px=1.0),
)
_MAKES = (
    FAST,
    # OpenCV's eight paths over a larger block; P1 and P2 are 8 and 32 times its area.
    Matcher(
        engine=SemiGlobalBlock(mode="hh", block_px=9, small_penalty=648, large_penalty=2592),
        refinement=Refinement(median_px=3),
        checks=Checks(uniqueness=5.0, left_right_px=2.0),
    ),
    # Block matching with a small and a large window.
    Matcher(
        engine=Block(block_px=11),
        checks=Checks(uniqueness=10.0, left_right_px=1.0, speckle_count=50),
    ),
    Matcher(
        engine=Block(block_px=21),
        refinement=Refinement(median_px=5),
        checks=Checks(uniqueness=15.0, texture_dn=1.0, speckle_count=200, speckle_step_px=2.0),
    ),
    OAK,
    SAPIEN,
    # Census in a square window, without paths.
    Matcher(
        engine=CensusSemiGlobal(
            census_px=5,
            presmooth_px=0.0,
            difference_weight=0.0,
            support_px=9,
            arm_step_dn=255.0,
            small_penalty=0.0,
            large_penalty=0.0,
        ),
        checks=Checks(uniqueness=8.0, left_right_px=1.0, speckle_count=60),
    ),
)


def other_makes(matcher: Matcher) -> tuple[Matcher, ...]:
    """Return matchers of other makes with the search range of a matcher.

    Args:
        matcher: matcher of the base. A make that equals it is left out.
    """
    makes = (
        dataclasses.replace(
            make,
            min_disparity_px=matcher.min_disparity_px,
            search_px=matcher.search_px,
            extended=matcher.extended,
        )
        for make in _MAKES
    )
    return tuple(make for make in makes if make != matcher)
