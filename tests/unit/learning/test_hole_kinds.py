"""Kinds of holes on synthetic scenes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from starling.learning.data.example import Example
from starling.learning.features.holes import KINDS, hole_kinds
from starling.patterns.errors import InputError
from tests.unit.learning.seen import FOCAL_PX, HEIGHT, WIDTH, box, example, flat, info

ROWS, COLUMNS = np.indices((HEIGHT, WIDTH))


def kind_of(scene: Example) -> np.ndarray:
    """Name of each pixel's kind, (h, w)."""
    kinds = hole_kinds(scene)
    assert list(kinds) == list(KINDS)
    return np.array(list(kinds))[np.argmax(list(kinds.values()), axis=0)]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), boxes=st.integers(0, 5), unknown=st.floats(0, 0.9))
def test_every_pixel_is_of_one_kind(seed, boxes, unknown):
    rng = np.random.default_rng(seed)
    disparity = flat(rng.uniform(2, 140)) + rng.normal(0, 0.3, (HEIGHT, WIDTH))
    for _ in range(boxes):
        top, left = rng.integers(0, HEIGHT - 5), rng.integers(0, WIDTH - 5)
        disparity[top : top + 20, left : left + 30] = rng.uniform(2, 200)
    disparity = np.maximum(disparity, 0.5)
    disparity[rng.random(disparity.shape) < unknown] = np.nan
    light = rng.uniform(0.01, 0.95, disparity.shape).astype(np.float32)
    kinds = hole_kinds(example(disparity, reflectance=light))
    assert_array_equal(np.sum(list(kinds.values()), axis=0), 1)


@pytest.mark.parametrize(
    ("disparity_px", "kind"),
    [(127.0, "near"), (125.5, "other"), (20.0, "other"), (16.5, "other"), (15.5, "far")],
)
def test_a_wall_is_near_far_or_neither(disparity_px, kind):
    assert set(kind_of(example(flat(disparity_px))).ravel()) == {kind}


def test_occlusion_and_edges_of_a_pillar():
    """A pillar in columns 55 to 94 at 40 px hides 19.5 px of a wall at 20.5 px on its left.

    An edge is between two pixels; ten pixels on either side belong to it.
    """
    result = kind_of(example(box(55, 94, back_px=20.5, front_px=40.0)))
    assert_array_equal(result == "occluded", (COLUMNS > 35.5) & (COLUMNS < 55))
    right_of_left_edge, around_right_edge = COLUMNS - 55, np.abs(COLUMNS - 94.5)
    assert set(result[(right_of_left_edge >= 0) & (right_of_left_edge < 9)]) == {"edge"}
    assert set(result[around_right_edge < 9]) == {"edge"}
    assert set(result[(right_of_left_edge >= 9) & (around_right_edge > 9)]) == {"other"}
    assert set(result[COLUMNS < 36]) == {"other"}


def test_a_plane_is_grazing_where_its_normal_is_more_than_70_degrees_off():
    """d = 36 + 0.6 (v - cy): its normal is (0, f b, d0), in closed form at every pixel."""
    camera, slope, middle = info(), 0.6, 36.0
    rows, columns = ROWS - camera.cy_px, COLUMNS - camera.cx_px
    disparity = middle + slope * rows
    ray = np.sqrt(1 + (columns**2 + rows**2) / FOCAL_PX**2)
    cosine = disparity / (np.hypot(FOCAL_PX * slope, middle) * ray)
    angle = np.degrees(np.arccos(cosine))
    result = kind_of(example(disparity))
    assert 0.2 < (angle > 70).mean() < 0.8
    clear = np.abs(angle - 70) > 0.05  # Single precision.
    assert_array_equal((result == "grazing")[clear], (angle > 70)[clear])


def test_a_patch_is_dark_below_half_the_median_of_the_infrared():
    light = np.full((HEIGHT, WIDTH), 0.6, np.float32)
    light[10:20, 30:50] = 0.29
    light[30:40, 30:50] = 0.31
    patch = (ROWS >= 10) & (ROWS < 20) & (COLUMNS >= 30) & (COLUMNS < 50)
    assert_array_equal(kind_of(example(flat(20.0), reflectance=light)) == "dark", patch)
    assert "dark" not in kind_of(example(flat(20.0)))


def test_a_pixel_has_the_first_kind_that_applies():
    """A dark, too near wall is near; a dark, far wall is dark."""
    light = np.full((HEIGHT, WIDTH), 0.6, np.float32)
    light[:, :40] = 0.1
    near = kind_of(example(flat(130.0), reflectance=light))
    far = kind_of(example(flat(8.0), reflectance=light))
    assert set(near.ravel()) == {"near"}
    assert_array_equal(far, np.where(COLUMNS < 40, "dark", "far"))


def test_an_unknown_pixel_has_the_kind_of_its_nearest_neighbour():
    disparity = box(0, 59, back_px=20.0, front_px=8.0)
    disparity[20:30, 5:15] = np.nan
    assert set(kind_of(example(disparity))[20:30, 5:15].ravel()) == {"far"}
    nothing = dataclasses.replace(example(flat()), depth_m=np.full((HEIGHT, WIDTH), np.nan, "f4"))
    with pytest.raises(InputError, match="reference depth must be known somewhere; got no pixel"):
        hole_kinds(nothing)
