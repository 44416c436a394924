"""Matcher settings: frozen numbers that refuse nonsense by name."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

from starling.patterns.errors import InputError
from starling.sim.sensor.matcher import (
    D4XX,
    FAST,
    Block,
    CensusSemiGlobal,
    Checks,
    Matcher,
    Refinement,
    SemiGlobalBlock,
    named,
    names,
)


def test_names_give_the_settings():
    assert {"d4xx", "fast"} <= set(names())
    assert named("fast") is FAST
    assert named("d4xx") is D4XX


def test_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"matcher must be a known name; got 'd4x'\.") as refusal:
        named("d4x")
    assert all(name in str(refusal.value) for name in names())


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: SemiGlobalBlock(mode="4way"), "mode must be a known name"),  # type: ignore[arg-type]
        (lambda: SemiGlobalBlock(block_px=4), "block_px must be odd"),
        (lambda: SemiGlobalBlock(block_px=23), "block_px must be in"),
        (lambda: SemiGlobalBlock(small_penalty=900), "large_penalty must be > small_penalty 900"),
        (lambda: SemiGlobalBlock(prefilter_cap=128), "prefilter_cap must be in"),
        (lambda: Block(block_px=3), "block_px must be in"),
        (lambda: Block(prefilter_cap=0), "prefilter_cap must be in"),
        (lambda: CensusSemiGlobal(census_px=13), "census_px must be in"),
        (lambda: CensusSemiGlobal(presmooth_px=-1), "presmooth_px must be in"),
        (lambda: CensusSemiGlobal(tolerance_dn=-1), "tolerance_dn must be in"),
        (lambda: CensusSemiGlobal(support_px=2), "support_px must be odd"),
        (lambda: CensusSemiGlobal(arm_step_dn=-1), "arm_step_dn must be in"),
        (lambda: CensusSemiGlobal(large_penalty=1), "large_penalty must be >= small_penalty 12"),
        (
            lambda: CensusSemiGlobal(difference_weight=8, difference_cap_dn=255),
            "difference_weight times difference_cap_dn must be <= 128 bit; got 2040",
        ),
        (lambda: Refinement(median_px=7), "median_px must be 0, 3 or 5; got 7"),
        (lambda: Refinement(smooth_px=4), "smooth_px must be odd"),
        (lambda: Refinement(smooth_rows_px=0), "smooth_rows_px must be in [1, 31]; got 0"),
        (lambda: Refinement(smooth_rows_px=2.5), "smooth_rows_px must be a whole number"),  # pyright: ignore
        (lambda: Refinement(smooth_step_px=-1), "smooth_step_px must be in"),
        (lambda: Refinement(mean_quantum_px=2), "mean_quantum_px must be in [0, 1]; got 2"),
        (lambda: Checks(support_share=1.5), "support_share must be in [0, 1]; got 1.5"),
        (lambda: Checks(support_step_px=-1), "support_step_px must be in"),
        (lambda: Refinement(quantum_px=2), "quantum_px must be in"),
        (lambda: Refinement(locking_px=0.16), "locking_px must be in [-0.15, 0.15]; got 0.16"),
        (lambda: CensusSemiGlobal(second_peak=-1), "second_peak must be in"),
        (lambda: CensusSemiGlobal(neighbour_peak=1001), "neighbour_peak must be in"),
        (lambda: CensusSemiGlobal(small_penalty=101), "small_penalty must be in [0, 100]"),
        (lambda: Checks(uniqueness=101), "uniqueness must be in"),
        (lambda: Checks(left_right_px=-1), "left_right_px must be in"),
        (lambda: Checks(left_right_mean_px=4), "left_right_mean_px must be odd"),
        (lambda: Checks(texture_dn=float("nan")), "texture_dn must be in"),
        (lambda: Checks(jump_px=-1), "jump_px must be in"),
        (lambda: Checks(speckle_count=-1), "speckle_count must be in"),
        (lambda: Checks(speckle_count=1.5), "speckle_count must be a whole number"),  # type: ignore[arg-type]
        (lambda: Checks(speckle_step_px=-1), "speckle_step_px must be in"),
        (lambda: Matcher(engine="sgbm"), "engine must be SemiGlobalBlock"),  # type: ignore[arg-type]
        (lambda: Matcher(min_disparity_px=-1), "min_disparity_px must be in"),
        (lambda: Matcher(search_px=100), "search_px must be a multiple of 16"),
        (lambda: Matcher(search_px=512), "search_px must be in"),
    ],
)
def test_nonsense_is_refused(build, message):
    with pytest.raises(InputError) as refusal:
        build()
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        D4XX.checks.uniqueness = 3.0  # type: ignore[misc]


def test_settings_load_no_compiler_and_no_opencv():
    code = (
        "import sys, starling.sim.sensor.matcher; "
        "print(sorted({'cv2', 'numba', 'scipy'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
