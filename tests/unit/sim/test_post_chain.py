"""The post-processing chain: order, reasons, consistency and error messages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.reason import Reason
from starling.sim.sensor.matcher import named
from starling.sim.sensor.post import Post, refuse_single_frame
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap, depth_from_disparity, to_code
from starling.sim.stereo.measurement import measure
from starling.sim.stereo.post import chain

NAN = np.float32(np.nan)
SENSOR = Sensor(
    name="mine",
    width=64,
    height=48,
    fx_px=500.0,
    fy_px=500.0,
    cx_px=31.5,
    cy_px=23.5,
    baseline_m=0.05,
    matcher=dataclasses.replace(named("fast"), search_px=32),
)
ALL = {
    "near_m": 0.5,
    "far_m": 2.0,
    "spatial_alpha": 0.5,
    "temporal_alpha": 0.4,
    "hole_filling": "farthest",
}


def sensor(**post) -> Sensor:
    return dataclasses.replace(SENSOR, post=Post(**post))


def raw_map(disparity, reason=Reason.SUPPORT) -> DepthMap:
    disparity = np.asarray(disparity, np.float32)
    valid = np.isfinite(disparity)
    return DepthMap(
        disparity_px=disparity,
        depth_m=depth_from_disparity(disparity, focal_px=500.0, baseline_m=0.05),
        valid=valid,
        reason=np.where(valid, 0, reason).astype(np.uint32),
    )


def noisy(seed=0, shape=(48, 64)) -> DepthMap:
    rng = np.random.default_rng(seed)
    disparity = 20 + rng.normal(0, 0.1, shape).astype(np.float32)
    disparity[:, 40:] += 15
    disparity[rng.random(shape) < 0.1] = np.nan
    return raw_map(disparity)


def test_everything_off_returns_the_map_itself():
    raw = noisy()
    assert chain.process(raw, SENSOR, causes={}) is raw


@pytest.mark.parametrize("side", [1, 2, 3, 5, 8])
@given(seed=st.integers(0, 50), off=st.sets(st.sampled_from(sorted(ALL))))
def test_map_stays_consistent(side, seed, off):
    """z = f b / d, valid, reason and NaN say the same after any set of filters."""
    post = {name: value for name, value in ALL.items() if name not in off}
    result = chain.process(noisy(seed), sensor(**post, decimation=side), causes={})
    assert result.disparity_px.shape == (48, 64)
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(result.depth_m, np.float32(25) / result.disparity_px)
    np.testing.assert_array_equal(result.valid, np.isfinite(result.depth_m))
    np.testing.assert_array_equal(result.valid, result.reason == Reason.VALID)
    assert (result.history is None) == ("temporal_alpha" in off)
    if "far_m" not in off:
        assert not (result.depth_m > 2.0 + 1e-5).any()


def test_reasons_of_removed_and_filled_pixels():
    """A 3 x 7 map in blocks of 2: one too far, one with a hole, incomplete row and column."""
    near, far = 20.0, 5.0
    raw = raw_map(
        [
            [near, NAN, far, far, near, near, near],
            [near, near, far, NAN, near, near, near],
            [near, NAN, near, near, near, near, near],
        ],
        Reason.LEFT_RIGHT,
    )
    result = chain.process(raw, sensor(decimation=2, far_m=3.0), causes={})
    post, gone, old = Reason.POST_FILTER, Reason.OUT_OF_RANGE, Reason.LEFT_RIGHT
    assert result.reason.tolist() == [
        [0, 0, gone, gone, 0, 0, post],
        [0, 0, gone, old, 0, 0, post],
        [post, old, post, post, post, post, post],
    ]


def test_known_causes_precede_the_range():
    raw = raw_map([[20.0, 5.0, 5.0]])
    shadow = {Reason.SHADOWED: np.array([[True, True, False]])}
    result = chain.process(raw, sensor(far_m=3.0), causes=shadow)
    assert result.reason.tolist() == [[0, Reason.SHADOWED, Reason.OUT_OF_RANGE]]


def test_filled_pixels_are_valid():
    result = chain.process(raw_map([[20.0, NAN, 30.0]]), sensor(hole_filling="left"), causes={})
    assert result.depth_m.tolist() == [[1.25, 1.25, pytest.approx(0.833)]]
    assert result.valid.all() and not result.reason.any()


def test_depth_beyond_the_code_is_out_of_range():
    raw = raw_map([[25 / 6.0, 25 / 7.0, -1.0, 0.0]])
    result = chain.process(raw, sensor(depth_unit_m=1e-4), causes={})
    gone = Reason.OUT_OF_RANGE
    assert result.reason.tolist() == [[0, gone, gone, gone]]
    assert to_code(result.depth_m, 1e-4)[0, 1] == 0


@pytest.mark.parametrize("off", sorted(ALL))
def test_filtered_depth_is_in_whole_depth_units(off):
    """Filters act on the codes of the device; without them depth stays unrounded."""
    post = {name: value for name, value in ALL.items() if name != off}
    depth_m = chain.process(noisy(), sensor(**post, depth_unit_m=1e-4), causes={}).depth_m
    units = depth_m[np.isfinite(depth_m)].astype(np.float64) / 1e-4
    np.testing.assert_allclose(units, np.rint(units), atol=0.01)
    limited = chain.process(noisy(), sensor(near_m=0.5, far_m=2.0), causes={})
    known = np.isfinite(limited.depth_m)
    np.testing.assert_array_equal(limited.depth_m[known], noisy().depth_m[known])


def test_a_padded_border_lets_the_last_row_fill():
    """A decimated image of 3 rows gets a fourth, so its last row is not the border."""
    image = np.full((9, 16), 20.0, np.float32)
    image[6:, 8:] = NAN
    result = chain.process(raw_map(image), sensor(decimation=3, hole_filling="farthest"), causes={})
    assert result.valid[:, :15].all()


def test_threshold_comes_after_decimation():
    """The threshold applies to the block's median, not to its pixels."""
    raw = raw_map([[20.0, 20.0], [20.0, 5.0]])
    result = chain.process(raw, sensor(decimation=2, far_m=3.0), causes={})
    assert result.disparity_px.tolist() == [[20.0, 20.0], [20.0, 20.0]]


def test_hole_filling_comes_after_the_smoothing():
    """Otherwise filled pixels would be smoothed with their source."""
    image = np.full((1, 6), NAN, np.float32)
    image[0, :2] = 20.0, 20.4
    result = chain.process(
        raw_map(image), sensor(spatial_alpha=0.5, hole_filling="left"), causes={}
    ).disparity_px[0]
    smoothed = chain.process(raw_map(image), sensor(spatial_alpha=0.5), causes={}).disparity_px[0]
    np.testing.assert_array_equal(result[2:], smoothed[1])


@pytest.mark.parametrize(("side", "remaining"), [(1, True), (2, False)])
def test_deltas_are_in_pixels_of_the_decimated_image(side, remaining):
    """An edge of 1 px is 0.5 px in an image of half the size, which is no edge for 0.625 px."""
    image = np.full((8, 32), 20.0, np.float32)
    image[:, 16:] = 21.0
    result = chain.process(raw_map(image), sensor(decimation=side, spatial_alpha=0.5), causes={})
    assert np.allclose(result.disparity_px, image, atol=0.05) == remaining


@pytest.mark.parametrize(("side", "remaining"), [(1, True), (2, False)])
def test_temporal_delta_is_in_pixels_of_the_decimated_image(side, remaining):
    settings = sensor(decimation=side, temporal_alpha=0.5)
    first = chain.process(raw_map(np.full((4, 4), 20.0)), settings, causes={})
    jumped = raw_map(np.full((4, 4), 21.0))
    result = chain.process(jumped, settings, causes={}, past=first.history)
    assert np.allclose(result.disparity_px, 21.0, atol=0.05) == remaining


def test_frames_are_chained_by_their_history():
    """The second frame averages with the first and fills from it; neither is changed."""
    settings = sensor(temporal_alpha=0.25, temporal_persistence=5)
    first = chain.process(raw_map([[20.0, 20.0, 20.0]]), settings, causes={})
    second = raw_map([[20.4, NAN, 25.0]])
    result = chain.process(second, settings, causes={}, past=first.history)
    np.testing.assert_allclose(result.disparity_px, [[20.1, 20.0, 25.0]], rtol=5e-4)
    assert not result.reason.any()
    np.testing.assert_allclose(first.disparity_px, [[20.0, 20.0, 20.0]], rtol=1e-6)
    assert np.isnan(second.disparity_px[0, 1])


def test_measure_matches_and_post_processes():
    """Random dots 6 px apart: every filter's trace is in what `measure` returns."""
    dots = np.random.default_rng(3).integers(0, 255, (48, 64), np.uint8)
    pair = dots, np.roll(dots, -6, axis=1)
    plain = measure(*pair, SENSOR, causes={})
    assert np.nanmedian(plain.disparity_px) == pytest.approx(6, abs=0.1)
    assert plain.history is None and not plain.valid.all()
    filled = measure(*pair, sensor(hole_filling="left", temporal_alpha=0.4), causes={})
    assert filled.valid.mean() > plain.valid.mean()
    again = measure(*pair, sensor(temporal_alpha=0.4), causes={}, past=filled.history)
    assert again.history is not None
    np.testing.assert_allclose(again.depth_m, plain.depth_m, atol=0.0005001)
    far = measure(*pair, sensor(far_m=1.0), causes={})
    assert set(far.reason[plain.valid]) == {Reason.OUT_OF_RANGE}
    np.testing.assert_array_equal(far.reason[~plain.valid], plain.reason[~plain.valid])


def test_temporal_filter_on_one_frame_is_refused():
    message = r"^post\.temporal_alpha must be 1 for a single frame; got 0\.4\. Give --frames 2 or"
    with pytest.raises(InputError, match=message):
        refuse_single_frame(Post(temporal_alpha=0.4), 1)
    refuse_single_frame(Post(temporal_alpha=0.4), 2)
    refuse_single_frame(Post(), 1)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("decimation", 9, r"must be in \[1, 8\]"),
        ("decimation", 2.5, "must be a whole number"),
        ("spatial_alpha", 0.2, r"must be in \[0.25, 1\]"),
        ("spatial_delta_px", 20 * 32, r"must be in \[0, 64\]"),
        ("spatial_iterations", 1.5, "must be a whole number"),
        ("spatial_holes", 6, r"must be in \[0, 5\]"),
        ("temporal_alpha", 40, r"must be in \[0, 1\]"),
        ("temporal_delta_px", -1.0, r"must be in \[0, 64\]"),
        ("temporal_persistence", 9, r"must be in \[0, 8\]"),
        ("temporal_persistence", 0.5, "must be a whole number"),
        ("hole_filling", "right", "must be a known name"),
        ("far_m", 4000, r"must be in \[0, 1000\]"),
        ("far_m", 0.0, "must be > post.near_m"),
        ("depth_unit_m", 0.0, "must be > 0"),
    ],
)
def test_settings_are_refused_in_one_line(name, value, rule):
    with pytest.raises(InputError, match=rf"^post\.{name} {rule}; got '?{value}'?\. \S") as refusal:
        Post(**{name: value})
    assert "\n" not in str(refusal.value)
