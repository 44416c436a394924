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
from starling.sim.stereo.post import decimation, hole_filling, spatial, temporal, threshold

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


def test_a_difference_of_exactly_delta_is_an_edge():
    image = np.array([[20.0, 20.5, 20.25]], np.float32)
    result = spatial.smooth(image[:, :2], alpha=0.5, delta_px=0.5, iterations=1)
    np.testing.assert_array_equal(result, image[:, :2])
    _, past = temporal.smooth(image[:, :1], None, alpha=0.5, delta_px=0.5, persistence=0)
    result, _ = temporal.smooth(image[:, 1:2], past, alpha=0.5, delta_px=0.5, persistence=0)
    assert result[0, 0] == 20.5
    result, _ = temporal.smooth(image[:, 2:], past, alpha=0.5, delta_px=0.5, persistence=0)
    assert result[0, 0] == 20.125


@pytest.mark.parametrize("side", range(1, 9))
@given(data=st.data())
def test_decimation_takes_median_or_mean_of_valid_depths(side, data):
    image = data.draw(maps())
    h, w = image.shape
    result = decimation.decimate(image, side)
    assert result.shape == (h // side, w // side)
    for row, column in np.ndindex(result.shape):
        block = image[row * side : (row + 1) * side, column * side : (column + 1) * side]
        depths = np.sort(1 / block[np.isfinite(block)].astype(np.float64))
        if not depths.size:
            assert np.isnan(result[row, column])
        elif side <= 3:
            assert result[row, column] == pytest.approx(
                1 / depths[(depths.size - 1) // 2], rel=1e-6
            )
        else:
            assert result[row, column] == pytest.approx(1 / depths.mean(), rel=1e-5)


@given(maps(), st.integers(2, 8))
def test_decimation_gives_constant_blocks_and_is_idempotent(image, side):
    blocks = decimation.decimate(image, side)
    large = decimation.enlarge(blocks, side, image.shape)
    assert large.shape == image.shape
    rows, columns = blocks.shape
    repeated = blocks.repeat(side, axis=0).repeat(side, axis=1)
    np.testing.assert_array_equal(large[: rows * side, : columns * side], repeated)
    assert np.isnan(large[rows * side :]).all() and np.isnan(large[:, columns * side :]).all()
    np.testing.assert_allclose(decimation.decimate(large, side), blocks, rtol=1e-6)


def fill_twin(image, mode):
    out = image.copy()
    h, w = out.shape
    rows = range(h) if mode == "left" else range(1, h - 1)
    for y, x in product(rows, range(1, w)):
        if np.isfinite(out[y, x]):
            continue
        if mode == "left":
            out[y, x] = out[y, x - 1]
            continue
        around = [out[y - 1, x - 1], out[y, x - 1], out[y + 1, x - 1], out[y - 1, x], out[y + 1, x]]
        known = [value for value in around if np.isfinite(value)]
        if mode == "farthest" and known:
            out[y, x] = min(known)
        if mode == "nearest" and np.isfinite(out[y - 1, x]):
            out[y, x] = max(known)
    return out


@pytest.mark.parametrize("mode", MODES)
@given(image=maps())
def test_hole_filling_matches_the_slow_reference_and_keeps_depth(mode, image):
    result = hole_filling.fill(image, mode)
    np.testing.assert_array_equal(result, fill_twin(image, mode))
    known = np.isfinite(image)
    np.testing.assert_array_equal(result[known], image[known])
    assert np.isin(result[np.isfinite(result)], image[known]).all()


@given(maps())
def test_filling_from_the_left_is_idempotent(image):
    once = hole_filling.fill(image, "left")
    np.testing.assert_array_equal(hole_filling.fill(once, "left"), once)


def test_hole_filling_by_hand():
    """One hole among five known neighbours; larger disparity is nearer."""
    image = np.array([[9, 5, 1], [4, NAN, 2], [7, 8, 3]], np.float32)
    centre = {mode: hole_filling.fill(image, mode)[1, 1] for mode in MODES}
    assert centre == {"left": 4, "farthest": 4, "nearest": 9}


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


@given(maps(), st.floats(0.25, 0.99), st.sampled_from(MODES), st.integers(1, 8))
def test_no_filter_leaves_the_range_of_its_input(image, alpha, mode, side):
    """Filters are means, medians or copies, so values stay in the input's range up to rounding."""
    filtered = [
        decimation.decimate(image, side),
        spatial.smooth(image, alpha=alpha, delta_px=9.0, iterations=2),
        hole_filling.fill(image, mode),
    ]
    _, past = temporal.smooth(image, None, alpha=alpha, delta_px=9.0, persistence=3)
    out, _ = temporal.smooth(image[::-1], past, alpha=alpha, delta_px=9.0, persistence=3)
    known = image[np.isfinite(image)]
    for result in (*filtered, out):
        valid_pixels = result[np.isfinite(result)]
        assert known.size or not valid_pixels.size
        if valid_pixels.size:
            assert (
                known.min() - 1e-4 <= valid_pixels.min()
                and valid_pixels.max() <= known.max() + 1e-4
            )


@given(maps())
def test_neutral_filters_return_the_input_itself(image):
    assert decimation.decimate(image, 1) is image
    assert decimation.enlarge(image, 1, image.shape) is image
    assert spatial.smooth(image, alpha=1.0, delta_px=0.625, iterations=2) is image
    result, history = temporal.smooth(image, None, alpha=1.0, delta_px=0.625, persistence=3)
    assert result is image and history is None
    assert hole_filling.fill(image, "off") is image
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
