"""The matcher of a batch against the compiled one, on equal infrared pairs."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from starling.sim import simulate
from starling.sim.arrays import Image
from starling.sim.corrupt import Corruptor
from starling.sim.imaging.imager import Infrared, dark_window
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.checks import TEXTURE_PX
from starling.sim.stereo.matching import match
from tests.unit.sim.batch import steps

wp: Any = pytest.importorskip("warp", reason="warp-lang is not installed")

from starling.sim.batch import handoff, matching, refinement  # noqa: E402
from starling.sim.batch.dark_table import dark_table  # noqa: E402

EQUAL_SHARE = 0.999  # Least share of pixels with the same reason.
UNIT_PX = 1 / 32  # Largest difference of disparities: the device's step [px].


def infrared(sensor: Sensor, seed: int, depth_m: Image) -> tuple[Infrared, Infrared]:
    """Noisy pair that the matcher reads."""
    corruptor = Corruptor(sensor, steps.MATRIX)
    layers = corruptor.light(depth_m).layers
    scene = corruptor._scene
    pair = simulate.infrared(layers, scene, corruptor.sensor, seed=seed)
    assert pair.matched_right is not None
    return pair.matched_left, pair.matched_right


def assert_equal(sensor: Sensor, depth_m: Image) -> Image:
    """Compare two pairs of a depth image; return the disparities of the batch (2, h, w)."""
    handoff.import_warp()
    pairs = [infrared(sensor, seed, depth_m) for seed in (1, 2)]
    left, right = (
        wp.array(np.stack(views).astype(np.uint16)) for views in zip(*pairs, strict=True)
    )
    bits = min(sensor.left.matched_bits, 10)
    dark = dark_window(sensor.left, bits)
    rig = matching.match_rig(sensor.matcher, bits, dark_table(sensor.left, bits), "cpu")
    gain = wp.array([sensor.left.gain] * 2, dtype=float)
    disparity, reason = (each.numpy() for each in matching.match(left, right, gain, rig))
    for number, pair in enumerate(pairs):
        expected = match(*pair, sensor.matcher, dark=dark)
        assert (reason[number] == expected.reason).mean() >= EQUAL_SHARE
        both = np.isfinite(disparity[number]) & expected.valid
        assert both.any()
        off = np.abs(disparity[number] - expected.disparity_px)[both]
        assert (off <= UNIT_PX).mean() >= EQUAL_SHARE
    assert np.array_equal(np.isfinite(disparity), reason == 0)
    return disparity


@pytest.mark.parametrize(
    "changes",
    [
        (),
        ("imager.dropped_bits=0",),
        ("matcher.search_px=48",),  # A tile smaller than its block of threads.
        ("matcher.min_disparity_px=3", "matcher.checks.border_px=2.5"),
        ("matcher.checks.left_right_mean_px=0", "matcher.checks.uniqueness=3.0"),
        ("matcher.engine.second_peak=30.0", "matcher.engine.neighbour_peak=15.0"),
        ("matcher.refinement.median_px=0", "matcher.refinement.smooth_rows_px=5"),
        ("matcher.refinement.smooth_rows_px=8",),
        ("matcher.refinement.median_px=3", "matcher.refinement.locking_px=0.05"),
        ("matcher.engine.census_px=11", "matcher.engine.support_px=15"),
        ("matcher.engine.presmooth_px=0.0", "matcher.engine.arm_step_dn=255.0"),
        ("matcher.engine.difference_weight=0.5", "matcher.engine.tolerance_dn=0.0"),
        ("matcher.checks.texture_dn=12.0", "matcher.checks.jump_px=1.0"),
        ("matcher.checks.texture_dn=0.0", "matcher.checks.speckle_count=0"),
        ("matcher.checks.dark_noise=0.0",),
        ("matcher.checks.texture_dn=0.0", "matcher.checks.dark_noise=8.0"),
        ("matcher.checks.speckle_count=2000", "matcher.checks.speckle_step_px=0.2"),
        ("matcher.refinement.smooth_px=0", "matcher.refinement.quantum_px=0.0"),
        ("matcher.refinement.mean_quantum_px=0.015625", "matcher.refinement.locking_px=0.03"),
        ("matcher.checks.support_share=0.375", "matcher.checks.speckle_count=0"),
        ("matcher.checks.support_share=0.525", "matcher.checks.left_right_rows_px=3"),
        ("matcher.checks.support_share=0.6", "matcher.checks.support_step_px=0.5"),
        ("matcher.setting=oak",),
        ("matcher.engine.subpixel_fit=equal_slopes", "matcher.search_px=32"),
        ("matcher.engine.subpixel_fit=equal_slopes_of_sums", "matcher.search_px=32"),
        ("matcher.checks.near_end=true", "matcher.search_px=32"),
    ],
)
def test_equal_pairs_give_equal_disparities(changes: tuple[str, ...]) -> None:
    assert_equal(steps.sensor(*changes), steps.depth_image())


@pytest.mark.parametrize("name", ["d435", "d455"])
def test_a_batch_has_no_depth_in_empty_space(name: str) -> None:
    """The boxes of the depth image alone, at an exposure that does not fill pixels."""
    exposure = ("imager.auto_exposure_level=0", "imager.exposure_s=0.003")
    depth = steps.depth_image()
    depth[depth > 1] = np.nan
    disparity = assert_equal(steps.sensor(*exposure, name=name), depth)
    window = np.ones((TEXTURE_PX + 2, TEXTURE_PX + 2), np.uint8)  # The image is blurred by 1 px.
    near = cv2.dilate(np.isfinite(depth).astype(np.uint8), window).astype(bool)
    assert not np.isfinite(disparity[:, ~near]).any()


@pytest.mark.parametrize("count", [2, 9, 25])
def test_exchanges_sort(count: int) -> None:
    """A network sorts all numbers if it sorts all zeros and ones; a sample of them is drawn."""
    values = np.random.default_rng(0).integers(0, 2, (500, count))
    expected = np.sort(values, axis=1)
    for low, high in refinement.comparisons(count):
        pair = values[:, [low, high]]
        values[:, low], values[:, high] = pair.min(1), pair.max(1)
    assert np.array_equal(values, expected)
