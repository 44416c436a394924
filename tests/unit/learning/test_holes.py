"""Statistics of holes with known sizes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from starling.learning.features import holes
from starling.patterns.errors import InputError


def drawn() -> np.ndarray:
    mask = np.zeros((20, 30), bool)
    mask[2:5, 3:7] = True  # 3 x 4.
    mask[10, 10:20] = True  # A row.
    mask[15, 0] = mask[16, 1] = True  # Touch at a corner, at the image's border.
    return mask


def test_sizes_of_drawn_holes():
    result = holes.measure(drawn())
    order = np.argsort(result.area_px)
    np.testing.assert_array_equal(result.area_px[order], [2, 10, 12])
    np.testing.assert_array_equal(result.perimeter_px[order], [8, 22, 14])
    np.testing.assert_array_equal(np.sort(result.run_px), [1, 1, 4, 4, 4, 10])
    assert result.share == 24 / 600
    np.testing.assert_array_equal(np.unique(result.area_of_pixel_px, return_counts=True)[1],
                                  [2, 10, 12])  # fmt: skip


def test_an_inner_rim_adds_to_the_perimeter():
    ring = np.zeros((9, 9), bool)
    ring[2:7, 2:7] = True
    ring[4, 4] = False
    result = holes.measure(ring)
    assert result.area_px.tolist() == [24]
    assert result.perimeter_px.tolist() == [20 + 4]


def test_uncounted_pixels_are_not_holes():
    counted = np.ones((20, 30), bool)
    counted[:, 13] = False
    result = holes.measure(drawn(), counted)
    assert sorted(result.area_px) == [2, 3, 6, 12]
    assert result.share == 23 / 580


@given(arrays.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_holes_can_be_weighted_by_area(mask):
    result = holes.measure(mask)
    assert result.area_px.sum() == result.run_px.sum() == mask.sum()
    assert (result.perimeter_px <= 4 * result.area_px).all()
    assert (result.perimeter_px >= 4 * np.sqrt(result.area_px) - 1e-9).all()
    flipped = holes.measure(mask[::-1, ::-1])
    np.testing.assert_array_equal(np.sort(flipped.area_px), np.sort(result.area_px))


def test_images_are_pooled():
    item, none = holes.measure(drawn()), holes.measure(np.zeros((20, 30), bool))
    both = holes.pool([item, item, none, none])
    assert both.share == pytest.approx(item.share / 2)
    assert len(both.area_px) == len(both.perimeter_px) == 6
    assert len(both.run_px) == 12


def test_flicker_is_the_rate_of_changes_per_frame():
    repeats = np.zeros((4, 10, 10), bool)
    repeats[1, :2] = True  # 20 appear, 20 disappear, 0 change.
    assert holes.flicker_rate(repeats) == pytest.approx(0.4 / 3)
    counted = np.zeros((10, 10), bool)
    counted[:4] = True
    assert holes.flicker_rate(repeats, counted) == pytest.approx(1 / 3)


@given(
    st.lists(st.integers(1, 50), min_size=1, max_size=40),
    st.lists(st.integers(1, 50), min_size=1, max_size=40),
)
def test_the_distance_is_the_greatest_difference_of_cumulative_shares(item, second):
    result = holes.distance(np.array(item), np.array(second))
    up_to = np.arange(1, 51)
    shares = [(np.array(sample)[:, None] <= up_to).mean(axis=0) for sample in (item, second)]
    assert result.kolmogorov_smirnov == pytest.approx(np.abs(shares[0] - shares[1]).max())
    assert result.wasserstein_log >= 0
    back = holes.distance(np.array(second), np.array(item))
    assert back.wasserstein_log == pytest.approx(result.wasserstein_log)


def test_distance_of_doubled_sizes_is_the_logarithm_of_two():
    sizes = np.array([1, 3, 7, 20])
    result = holes.distance(sizes, 2 * sizes)
    assert result.wasserstein_log == pytest.approx(np.log(2))
    same = holes.distance(sizes, sizes[::-1])
    assert (same.kolmogorov_smirnov, same.wasserstein_log) == (0, 0)
    empty = holes.distance(sizes, sizes[:0])
    assert np.isnan([empty.kolmogorov_smirnov, empty.wasserstein_log]).all()


def test_invalid_masks_are_refused():
    with pytest.raises(InputError, match="ndp and counted must be images of one shape; got"):
        holes.measure(drawn(), np.ones((3, 3), bool))
    with pytest.raises(InputError, match="counted must hold a pixel; got 0"):
        holes.measure(drawn(), np.zeros((20, 30), bool))
    with pytest.raises(InputError, match="images must not be empty; got 0"):
        holes.pool([])
    with pytest.raises(InputError, match="repeats must be two frames or more"):
        holes.flicker_rate(drawn()[None])
    with pytest.raises(InputError, match="counted must hold a pixel; got 0"):
        holes.flicker_rate(np.zeros((2, 3, 3), bool), np.zeros((3, 3), bool))
