"""Post-processing filters against slow references, and properties of all filters."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from starling.patterns import InputError
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.stereo.depth import to_code
from starling.sim.stereo.post import (
    codes,
    decimation,
    disparity_transform,
    hole_filling,
    spatial,
    temporal,
    threshold,
)

NAN = np.float32(np.nan)
MODES = ("left", "farthest", "nearest")
GEOMETRY = {"focal_px": 500.0, "baseline_m": 0.05}


SHAPES = st.tuples(st.integers(1, 14), st.integers(1, 14))


@st.composite
def maps(draw, shapes=SHAPES):
    """Disparities in 1/32 px about 20 px, and holes."""
    shape = draw(shapes)
    steps = draw(arrays.arrays(np.int16, shape, elements=st.integers(600, 680)))
    holes = draw(arrays.arrays(np.bool_, shape))
    return np.where(holes, NAN, steps.astype(np.float32) / 32)


@st.composite
def depth_codes(draw, shapes=SHAPES):
    """Depth codes about 1 m, and holes."""
    codes = draw(arrays.arrays(np.uint16, draw(shapes), elements=st.integers(950, 1050)))
    holes = draw(arrays.arrays(np.bool_, codes.shape))
    return np.where(holes, 0, codes).astype(np.uint16)


def spatial_twin(image, alpha, delta, iterations):
    """Reference filter, line by line in the filter's precision, because rounding decides edges."""
    alpha, delta = np.float32(alpha), np.float32(delta)
    rest, out = np.float32(1) - alpha, image.copy()
    for _, axis, backward in product(range(iterations), (1, 0), (False, True)):
        lines = np.moveaxis(out, axis, 1)
        for line in lines:
            order = range(line.size - 1, -1, -1) if backward else range(line.size)
            before = state = np.nan
            for i in order:
                value = line[i]
                if abs(value - before) < delta:
                    line[i] = alpha * value + rest * state
                before, state = value, line[i]
    return out


@given(maps(), st.floats(0.25, 0.99), st.floats(0.05, 3.0), st.integers(1, 5))
def test_spatial_filter_matches_the_slow_reference(image, alpha, delta, iterations):
    result = spatial.smooth(image, alpha=alpha, delta_px=delta, iterations=iterations)
    np.testing.assert_array_equal(result, spatial_twin(image, alpha, delta, iterations))


def holes_twin(image, most):
    """Hole filling of the spatial filter: two passes; the last pixel looks at the next row."""
    out = image.copy().ravel()
    width = image.shape[1]
    for row in range(image.shape[0]):
        for order, step in ((range(1, width), -1), (range(width - 1, 0, -1), 1)):
            missing = 0
            for x in order:
                i = row * width + x
                missing = missing + 1 if np.isnan(out[i]) else 0
                if 0 < missing <= most and i + step < out.size:
                    out[i] = out[i + step]
    return out.reshape(image.shape)


@given(maps(), st.sampled_from([(1, 1), (2, 3), (3, 7), (4, 15), (5, 254)]))
def test_spatial_filter_fills_holes_along_rows(image, holes):
    mode, most = holes
    settings = {"alpha": 0.5, "delta_px": 0.625, "iterations": 1}
    smoothed = spatial.smooth(image, **settings)
    result = spatial.smooth(image, **settings, holes=mode)
    np.testing.assert_array_equal(result, holes_twin(smoothed, most))


def test_a_difference_of_exactly_delta_is_an_edge():
    image = np.array([[20.0, 20.5, 20.25]], np.float32)
    result = spatial.smooth(image[:, :2], alpha=0.5, delta_px=0.5, iterations=1)
    np.testing.assert_array_equal(result, image[:, :2])
    _, past = temporal.smooth(image[:, :1], None, alpha=0.5, delta_px=0.5, persistence=0)
    result, _ = temporal.smooth(image[:, 1:2], past, alpha=0.5, delta_px=0.5, persistence=0)
    assert result[0, 0] == 20.5
    result, _ = temporal.smooth(image[:, 2:], past, alpha=0.5, delta_px=0.5, persistence=0)
    assert result[0, 0] == 20.125


@pytest.mark.parametrize("side", range(2, 9))
@given(data=st.data())
def test_decimation_takes_median_or_mean_of_valid_depths(side, data):
    code = data.draw(depth_codes())
    rows, columns = code.shape[0] // side, code.shape[1] // side
    result = decimation.decimate(code, side)
    assert result.shape == (-(-rows // 4) * 4, -(-columns // 4) * 4)
    assert not result[rows:].any() and not result[:, columns:].any()
    for row, column in np.ndindex(rows, columns):
        block = code[row * side : (row + 1) * side, column * side : (column + 1) * side]
        known = np.sort(block[block > 0])
        if not known.size:
            expected = 0
        elif side <= 3:
            expected = known[(known.size - 1) // 2]
        else:
            expected = int(known.sum()) // known.size
        assert result[row, column] == expected


@given(depth_codes(), st.integers(2, 8))
def test_decimation_gives_constant_blocks_and_is_idempotent(code, side):
    blocks = decimation.decimate(code, side)
    large = decimation.enlarge(blocks, side, code.shape)
    rows, columns = code.shape[0] // side, code.shape[1] // side
    repeated = blocks[:rows, :columns].repeat(side, axis=0).repeat(side, axis=1)
    np.testing.assert_array_equal(large[: rows * side, : columns * side], repeated)
    assert not large[rows * side :].any() and not large[:, columns * side :].any()
    np.testing.assert_array_equal(decimation.decimate(large, side), blocks)


def test_mean_of_the_largest_codes_does_not_overflow():
    code = np.full((8, 8), 65535, np.uint16)
    assert decimation.decimate(code, 8)[0, 0] == 65535


def fill_twin(code, mode):
    out = code.copy()
    h, w = out.shape
    rows = range(h) if mode == "left" else range(1, h - 1)
    for y, x in product(rows, range(1, w)):
        if out[y, x]:
            continue
        if mode == "left":
            out[y, x] = out[y, x - 1]
            continue
        around = [out[y - 1, x - 1], out[y, x - 1], out[y + 1, x - 1], out[y - 1, x], out[y + 1, x]]
        known = [value for value in around if value]
        if mode == "farthest" and known:
            out[y, x] = max(known)
        if mode == "nearest" and out[y - 1, x]:
            out[y, x] = min(known)
    return out


@pytest.mark.parametrize("mode", MODES)
@given(code=depth_codes())
def test_hole_filling_matches_the_slow_reference_and_keeps_depth(mode, code):
    result = hole_filling.fill(code, mode)
    np.testing.assert_array_equal(result, fill_twin(code, mode))
    np.testing.assert_array_equal(result[code > 0], code[code > 0])
    assert np.isin(result[result > 0], code[code > 0]).all()


@given(depth_codes())
def test_filling_from_the_left_is_idempotent(code):
    once = hole_filling.fill(code, "left")
    np.testing.assert_array_equal(hole_filling.fill(once, "left"), once)


def test_hole_filling_by_hand():
    """One hole among five known neighbours."""
    code = np.array([[9, 5, 1], [4, 0, 2], [7, 8, 3]], np.uint16)
    centre = {mode: hole_filling.fill(code, mode)[1, 1] for mode in MODES}
    assert centre == {"left": 4, "farthest": 9, "nearest": 4}


@given(st.integers(1, 65535), st.sampled_from([1e-4, 1e-3, 1e-2]), st.integers(1, 8))
def test_disparity_of_a_code_becomes_the_code_again(code, unit_m, side):
    sensor = with_values(presets.load("d435"), [("post.depth_unit_m", unit_m)])
    scale = disparity_transform.product(sensor, side)
    disparity_px = disparity_transform.to_disparity(np.array([code, 0], np.uint16), scale)
    expected = sensor.fx_px / side * sensor.baseline_m / (code * unit_m)
    assert disparity_px[0] == pytest.approx(expected, rel=1e-6) and np.isnan(disparity_px[1])
    assert disparity_transform.to_code(disparity_px, scale).tolist() == [code, 0]


@given(
    arrays.arrays(np.float32, (3, 5), elements=st.floats(-1, 80, width=32) | st.just(np.nan)),
    st.sampled_from([1e-4, 1e-3, 0.0123]),
)
def test_codes_are_those_of_written_depth(depth_m, unit_m):
    sensor = with_values(presets.load("d435"), [("post.depth_unit_m", unit_m)])
    code = codes.encode(depth_m, unit_m)
    np.testing.assert_array_equal(code, to_code(depth_m, unit_m))
    disparity_px, decoded_m = codes.decode(code, sensor)
    np.testing.assert_array_equal(to_code(decoded_m, unit_m), code)
    expected = sensor.focal_baseline_px_m / disparity_px
    np.testing.assert_allclose(decoded_m, expected, rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(disparity_px), code == 0)


def test_code_threshold_keeps_both_ends():
    code = np.array([[0, 299, 300, 1234, 4000, 4001]], np.uint16)
    result = threshold.limit_codes(code, unit_m=1e-3, near_m=0.3, far_m=4.0)
    assert result.tolist() == [[0, 0, 300, 1234, 4000, 0]]


class RingTwin:
    """The temporal filter with a ring of eight bits a pixel, as the library keeps them."""

    def __init__(self, shape, alpha, delta, needed, last):
        self.alpha, self.delta = np.float32(alpha), np.float32(delta)
        self.needed, self.last = needed, last
        self.old, self.ring, self.now = np.full(shape, NAN), np.zeros((8, *shape), bool), 0

    def step(self, new):
        out = new.copy()
        for position in np.ndindex(new.shape):
            if np.isnan(new[position]):
                recent = [self.ring[(self.now - k) % 8][position] for k in range(1, self.last + 1)]
                out[position] = self.old[position] if sum(recent) >= self.needed else np.nan
                self.ring[self.now][position] = False
                continue
            if abs(new[position] - self.old[position]) < self.delta:
                out[position] = (
                    self.alpha * new[position] + (np.float32(1) - self.alpha) * self.old[position]
                )
            else:
                self.ring[:, *position] = False
            self.ring[self.now][position] = True
            self.old[position] = out[position]
        self.now = (self.now + 1) % 8
        return out


WINDOWS = {1: (8, 8), 2: (2, 3), 3: (2, 4), 4: (2, 8), 5: (1, 2), 6: (1, 5), 7: (1, 8)}


@pytest.mark.parametrize("mode", WINDOWS)
@given(frames=maps(shapes=st.just((14, 6))), alpha=st.floats(0.0, 0.99), delta=st.floats(0.1, 3.0))
def test_temporal_filter_matches_the_slow_reference(mode, frames, alpha, delta):
    twin, past = RingTwin((6,), alpha, delta, *WINDOWS[mode]), None
    for frame in frames:
        result, past = temporal.smooth(
            frame[None], past, alpha=alpha, delta_px=delta, persistence=mode
        )
        np.testing.assert_array_equal(result[0], twin.step(frame))


@given(maps(), st.floats(0.0, 3.0), st.floats(0.1, 3.0))
def test_threshold_keeps_exactly_the_range(image, near_m, width_m):
    far_m = near_m + width_m
    result = threshold.limit(image, **GEOMETRY, near_m=near_m, far_m=far_m)
    depth = np.float32(25) / image
    inside = (depth >= np.float32(near_m)) & (depth <= np.float32(far_m))
    np.testing.assert_array_equal(result, np.where(inside, image, NAN))
    again = threshold.limit(result, **GEOMETRY, near_m=near_m, far_m=far_m)
    assert again is result  # Nothing is left to take.


def test_both_ends_of_the_range_stay():
    image = np.array([[25.0, 12.5]], np.float32)  # 1 and 2 m.
    assert threshold.limit(image, **GEOMETRY, near_m=1.0, far_m=2.0) is image


def test_threshold_removes_disparities_beyond_infinity():
    image = np.array([[0.0, -2.0, 20.0, NAN]], np.float32)
    result = threshold.limit(image, **GEOMETRY, near_m=0.0, far_m=1e3)
    np.testing.assert_array_equal(result, [[NAN, NAN, 20.0, NAN]])
    for name in GEOMETRY:
        with pytest.raises(InputError, match=f"{name} must be > 0; got 0"):
            threshold.limit(image, **GEOMETRY | {name: 0.0}, near_m=0.0, far_m=1.0)


@given(maps(), st.floats(0.25, 0.99))
def test_no_smoothing_leaves_the_range_of_its_input(image, alpha):
    """Filtered values are means or copies, so they stay in the input's range up to rounding."""
    smoothed = spatial.smooth(image, alpha=alpha, delta_px=9.0, iterations=2)
    _, past = temporal.smooth(image, None, alpha=alpha, delta_px=9.0, persistence=3)
    out, _ = temporal.smooth(image[::-1], past, alpha=alpha, delta_px=9.0, persistence=3)
    known = image[np.isfinite(image)]
    for result in (smoothed, out):
        valid_pixels = result[np.isfinite(result)]
        assert known.size or not valid_pixels.size
        if valid_pixels.size:
            assert (
                known.min() - 1e-4 <= valid_pixels.min()
                and valid_pixels.max() <= known.max() + 1e-4
            )


@given(maps())
def test_neutral_filters_return_the_input_itself(image):
    code = np.arange(6, dtype=np.uint16).reshape(2, 3)
    assert decimation.decimate(code, 1) is code
    assert decimation.enlarge(code, 1, code.shape) is code
    assert hole_filling.fill(code, "off") is code
    assert hole_filling.fill(code + np.uint16(1), "left").all()
    assert spatial.smooth(image, alpha=1.0, delta_px=0.625, iterations=2) is image
    result, history = temporal.smooth(image, None, alpha=1.0, delta_px=0.625, persistence=3)
    assert result is image and history is None
    assert threshold.limit(image, **GEOMETRY, near_m=0.0, far_m=65.535) is image


def test_first_frame_passes_and_starts_the_history():
    image = np.array([[20.0, NAN]], np.float32)
    result, past = temporal.smooth(image, None, alpha=0.4, delta_px=1.0, persistence=8)
    assert result is image and past is not None
    assert past.seen.tolist() == [[1, 0]]


def test_history_of_another_size_is_refused():
    _, past = temporal.smooth(
        np.ones((4, 6), np.float32), None, alpha=0.4, delta_px=1.0, persistence=3
    )
    with pytest.raises(
        InputError, match=r"past must be of the frame's own size \(2, 3\); got \(4, 6"
    ):
        temporal.smooth(np.ones((2, 3), np.float32), past, alpha=0.4, delta_px=1.0, persistence=3)
    wrong: Any = np.ones((2, 3))
    for alpha in (0.4, 1.0):
        with pytest.raises(InputError, match="past must be a history or None; got ndarray"):
            temporal.smooth(wrong, wrong, alpha=alpha, delta_px=1.0, persistence=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seen": None}, "seen of History must be of type ndarray; got None"),
        ({"disparity_px": "a"}, "disparity_px of History must be of type ndarray"),
        ({"seen": np.zeros((2, 3))}, r"seen .* must be \(h, w\) uint8.*; got \(2, 3\) float64"),
        ({"seen": np.zeros((3, 2), np.uint8)}, "seen of History must be .* both of one size"),
        ({"disparity_px": np.zeros(3, np.float32)}, r"disparity_px .* must be \(h, w\) float32"),
    ],
)
def test_histories_of_other_types_are_refused(change: dict[str, Any], message: str):
    fields: Any = {"disparity_px": np.zeros((2, 3), np.float32), "seen": np.zeros((2, 3), np.uint8)}
    with pytest.raises(InputError, match=message):
        temporal.History(**{**fields, **change})
