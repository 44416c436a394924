"""Statistics of drawn holes whose sizes are known."""

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
    found = holes.measure(drawn())
    order = np.argsort(found.area_px)
    np.testing.assert_array_equal(found.area_px[order], [2, 10, 12])
    np.testing.assert_array_equal(found.perimeter_px[order], [8, 22, 14])
    np.testing.assert_array_equal(np.sort(found.run_px), [1, 1, 4, 4, 4, 10])
    assert found.share == 24 / 600
    np.testing.assert_array_equal(np.unique(found.area_of_pixel_px, return_counts=True)[1],
                                  [2, 10, 12])  # fmt: skip


def test_a_hole_in_a_hole_adds_its_rim():
    ring = np.zeros((9, 9), bool)
    ring[2:7, 2:7] = True
    ring[4, 4] = False
    found = holes.measure(ring)
    assert found.area_px.tolist() == [24]
    assert found.perimeter_px.tolist() == [20 + 4]


def test_what_is_not_counted_is_no_hole():
    counted = np.ones((20, 30), bool)
    counted[:, 13] = False
    found = holes.measure(drawn(), counted)
    assert sorted(found.area_px) == [2, 3, 6, 12]
    assert found.share == 23 / 580


@given(arrays.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_pixels_are_kept_count_of(mask):
    found = holes.measure(mask)
    assert found.area_px.sum() == found.run_px.sum() == mask.sum()
    assert (found.perimeter_px <= 4 * found.area_px).all()
    assert (found.perimeter_px >= 4 * np.sqrt(found.area_px) - 1e-9).all()
    flipped = holes.measure(mask[::-1, ::-1])
    np.testing.assert_array_equal(np.sort(flipped.area_px), np.sort(found.area_px))


def test_images_are_pooled():
    one, none = holes.measure(drawn()), holes.measure(np.zeros((20, 30), bool))
    both = holes.pool([one, one, none, none])
    assert both.share == pytest.approx(one.share / 2)
    assert len(both.area_px) == len(both.perimeter_px) == 6
    assert len(both.run_px) == 12


def test_flicker_counts_changes_a_frame():
    repeats = np.zeros((4, 10, 10), bool)
    repeats[1, :2] = True  # 20 come, 20 go, none.
    assert holes.flicker_rate(repeats) == pytest.approx(0.4 / 3)
    counted = np.zeros((10, 10), bool)
    counted[:4] = True
    assert holes.flicker_rate(repeats, counted) == pytest.approx(1 / 3)


@given(
    st.lists(st.integers(1, 50), min_size=1, max_size=40),
    st.lists(st.integers(1, 50), min_size=1, max_size=40),
)
def test_distance_is_the_largest_gap_of_the_cumulative_shares(one, other):
    found = holes.distance(np.array(one), np.array(other))
    up_to = np.arange(1, 51)
    shares = [(np.array(sample)[:, None] <= up_to).mean(axis=0) for sample in (one, other)]
    assert found.kolmogorov_smirnov == pytest.approx(np.abs(shares[0] - shares[1]).max())
    assert found.wasserstein_log >= 0
    back = holes.distance(np.array(other), np.array(one))
    assert back.wasserstein_log == pytest.approx(found.wasserstein_log)


def test_distance_of_doubled_sizes_is_the_logarithm_of_two():
    sizes = np.array([1, 3, 7, 20])
    found = holes.distance(sizes, 2 * sizes)
    assert found.wasserstein_log == pytest.approx(np.log(2))
    same = holes.distance(sizes, sizes[::-1])
    assert (same.kolmogorov_smirnov, same.wasserstein_log) == (0, 0)
    empty = holes.distance(sizes, sizes[:0])
    assert np.isnan([empty.kolmogorov_smirnov, empty.wasserstein_log]).all()


def test_what_cannot_be_measured_is_refused():
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
