"""Geometry of reference depth: planes, a sphere, steps at known pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.features.geometry import (
    edges_left,
    edges_right,
    gap_width,
    seen_from,
    signed_distance,
    thickness,
)
from starling.patterns.errors import InputError
from starling.sim.arrays import filled
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine, surface_planes

from .seen import BASELINE_M, FOCAL_PX, HEIGHT, WIDTH, box, flat, info

CAMERA = Pinhole.from_camera(info())
ALL = np.ones((HEIGHT, WIDTH), bool)


def rays() -> np.ndarray:
    """Rays (h, w, 3) of the small camera with z = 1."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    across, down = (u - CAMERA.cx_px) / FOCAL_PX, (v - CAMERA.cy_px) / FOCAL_PX
    return np.stack([across, down, np.ones_like(across)], axis=-1)


def plane_px(normal: np.ndarray, distance_m: float) -> np.ndarray:
    """Disparity (h, w) of the plane normal . X = distance, normal of unit length."""
    return (FOCAL_PX * BASELINE_M * (rays() @ normal) / distance_m).astype(np.float32)


@given(azimuth=st.floats(0, 2 * np.pi), slant=st.floats(0, 0.9), distance=st.floats(0.3, 3))
def test_a_tilted_plane_has_its_cosine_everywhere_and_no_roughness(azimuth, slant, distance):
    tilt = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.sin(slant)
    normal = np.array([*tilt, np.cos(slant)])
    disparity = plane_px(normal, distance)
    seen = disparity > 0.1  # The plane is in front of the camera.
    expected = rays() @ normal / np.linalg.norm(rays(), axis=-1)
    planes = surface_planes(disparity, seen)
    whole = signed_distance(seen) > 8
    assert_allclose(incidence_cosine(planes, CAMERA)[whole], expected[whole], atol=2e-4)
    assert_allclose(fit_planes(disparity, seen, 10).residual_px[whole], 0, atol=2e-4)


def test_holes_in_the_reference_do_not_change_normals():
    disparity = plane_px(np.array([0.6, 0.0, 0.8]), 1.0)
    known = np.random.default_rng(0).random(ALL.shape) < 0.6
    known[20:30, 50:60] = False  # Larger than the window, so that the nearest fit is used.
    planes = surface_planes(filled(disparity, known), known)
    slope = FOCAL_PX * BASELINE_M * 0.6 / FOCAL_PX
    assert_allclose(planes.across, slope, atol=1e-4)
    assert_allclose(planes.down, 0, atol=1e-4)


def test_a_sphere_has_its_cosine_on_its_inside():
    """Up to the error of a plane over 7 px on a radius of about 55 px; worse towards the limb."""
    centre, radius = np.array([0.0, 0.0, 0.8]), 0.35
    along = rays() / np.linalg.norm(rays(), axis=-1, keepdims=True)
    middle = along @ centre
    discriminant = middle**2 - (centre @ centre - radius**2)
    hit = discriminant > 0
    length = middle - np.sqrt(np.where(hit, discriminant, 0))
    point = along * length[..., None]
    expected = np.abs(np.sum((point - centre) / radius * along, axis=-1))
    disparity = np.where(hit, FOCAL_PX * BASELINE_M / point[..., 2], 1.0).astype(np.float32)
    inner = hit & (expected > 0.6)
    assert np.count_nonzero(inner) > 1000
    cosine = incidence_cosine(surface_planes(disparity, hit), CAMERA)
    assert_allclose(cosine[inner], expected[inner], atol=0.02)
    facing = hit & (expected > 0.85)
    assert_allclose(cosine[facing], expected[facing], atol=0.001)
    bump = disparity - fit_planes(disparity, hit, 3).disparity_px
    assert (bump[inner] > 0).mean() > 0.99  # It bulges towards the camera.


def test_normals_are_correct_up_to_a_depth_edge():
    disparity = box(50, 90).astype(np.float32)
    straight = incidence_cosine(fit_planes(disparity, ALL, 3), CAMERA)
    original = incidence_cosine(surface_planes(disparity, ALL), CAMERA)
    ray = 1 / np.linalg.norm(rays(), axis=-1)
    assert_allclose(original, ray, atol=1e-4)  # Both faces look along the axis.
    assert straight[30, 49] < 0.6  # A plain window fit is wrong at the edge.


@pytest.mark.parametrize("fraction", [1.0, 0.5])
def test_a_box_hides_a_strip_left_of_it_as_wide_as_its_step(fraction):
    """For a step of 10 px, 10 f columns left of column 50 are hidden, and no others."""
    seen = seen_from(box(50, 90).astype(np.float32), fraction)
    strip = np.zeros(WIDTH, bool)
    strip[50 - int(10 * fraction) + 1 : 50] = True  # The first pixel of the strip is on the edge.
    assert_array_equal(seen.hidden, np.broadcast_to(strip, ALL.shape))
    behind = np.clip(np.arange(WIDTH) - (50 - 10 * fraction), 0, None) * (np.arange(WIDTH) < 50)
    assert_allclose(seen.behind_px, np.broadcast_to(behind, ALL.shape), atol=1e-4)


def test_from_the_left_the_strip_is_on_the_right():
    disparity = box(50, 90).astype(np.float32)
    right = seen_from(disparity[:, ::-1], 0.5)
    left = seen_from(disparity, -0.5)
    assert_array_equal(left.hidden, right.hidden[:, ::-1])
    assert_array_equal(left.behind_px, right.behind_px[:, ::-1])
    assert left.hidden[30, 91:95].all()
    assert not left.hidden[:, :91].any()


def test_the_wall_reappears_behind_a_thin_pole_but_counts_as_behind():
    seen = seen_from(box(60, 62).astype(np.float32), 1.0)
    columns = np.flatnonzero(seen.hidden[0])
    assert columns.min() >= 50
    assert columns.max() <= 52  # Three columns wide, ten to the left.
    assert (seen.behind_px[0, 53:60] > 0).all()


def test_from_the_left_imager_itself_nothing_is_hidden():
    rough = 5 + 10 * np.random.default_rng(0).random(ALL.shape, np.float32)
    seen = seen_from(rough, 0.0)
    assert not seen.hidden.any()
    assert not seen.behind_px.any()


@given(slope=st.floats(-0.8, 0.8), fraction=st.floats(0.1, 1.0))
def test_a_slanted_wall_hides_nothing_of_itself(slope, fraction):
    ramp = 60 + slope * (np.arange(WIDTH, dtype=np.float32) - 60)
    seen = seen_from(np.broadcast_to(ramp, ALL.shape), fraction)
    assert not seen.hidden.any()
    assert_allclose(seen.behind_px, 0, atol=1e-4)


@given(seed=st.integers(0, 2**16), fraction=st.floats(0.1, 1.0))
def test_hidden_pixels_have_an_occluder(seed, fraction):
    """On any surface, a nearer surface right of the hidden pixel is projected beyond it."""
    rng = np.random.default_rng(seed)
    disparity = np.repeat(rng.uniform(0, 30, (8, 15)), 8, axis=1).astype(np.float32)
    seen = seen_from(disparity, fraction)
    assert (seen.behind_px[seen.hidden] > 0).all()
    nearest = np.maximum.accumulate(disparity[:, ::-1], axis=1)[:, ::-1]
    assert (nearest[seen.hidden] > disparity[seen.hidden] + 1).all()


def test_signed_distances_to_a_border():
    inside = np.zeros(ALL.shape, bool)
    inside[:, 40:50] = True
    row = signed_distance(inside)[30]
    assert_allclose(row[40:50], [0.5, 1.5, 2.5, 3.5, 4.5, 4.5, 3.5, 2.5, 1.5, 0.5], atol=0.05)
    assert_allclose(row[36:40], [-3.5, -2.5, -1.5, -0.5], atol=0.05)
    assert_array_equal(signed_distance(np.zeros(ALL.shape, bool)), -64)
    assert_array_equal(signed_distance(ALL), 64)


def test_edges_of_a_box_have_their_distance_step_and_side():
    left, right = (edge(box(50, 90).astype(np.float32)) for edge in (edges_left, edges_right))
    assert (left.distance_px[:, 50:60] == np.arange(0.5, 10)).all()
    assert (left.step_px[:, 50:91] == -10).all()  # On the box: the wall is beyond its left edge.
    assert (left.step_px[:, 91:] == 10).all()  # Right of the box: the box is in front.
    assert (right.distance_px[:, 40:50] == np.arange(9.5, 0, -1)).all()
    assert (right.step_px[:, :50] == 10).all()
    assert (left.distance_px[:, :50] == 128).all()
    assert (left.step_px[:, :50] == 0).all()


def test_a_step_of_a_pixel_is_no_edge():
    assert (edges_left(box(50, 90, front_px=6.0).astype(np.float32)).distance_px == 128).all()


@pytest.mark.parametrize(("width", "side"), [(2, 3), (4, 5), (8, 9), (16, 17), (30, 33)])
def test_thickness_is_the_square_that_does_not_fit(width, side):
    pole = box(50, 50 + width - 1).astype(np.float32)
    on_pole = slice(50, 50 + width)
    assert (thickness(pole)[:, on_pole] == side).all()
    assert (np.delete(thickness(pole), on_pole, axis=1) == 65).all()
    assert (gap_width(-pole)[:, on_pole] == side).all()
    assert (gap_width(pole) == 65).all()


def test_a_floor_that_rises_to_the_border_is_not_thin():
    floor = plane_px(np.array([0.0, 0.9, np.sqrt(1 - 0.81)]), 0.2)
    assert np.ptp(np.diff(floor, axis=0)) < 1e-3
    assert np.diff(floor, axis=0).mean() > 0.2
    assert (thickness(floor) == 65).all()
    assert (gap_width(floor) == 65).all()


def test_unknown_pixels_take_the_nearest_known():
    values = np.arange(5, dtype=np.float32)[None]
    known = np.array([[True, False, False, False, True]])
    assert filled(values, known)[0, [0, 1, 3, 4]].tolist() == [0, 0, 4, 4]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: filled(flat(), ~ALL), "reference depth must be known somewhere"),
        (lambda: fit_planes(flat().astype(np.float32), ~ALL, 3), "reference depth must be known"),
        (lambda: seen_from(flat(), 5.0), r"fraction must be in \[-4, 4\]"),
    ],
)
def test_invalid_disparities_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_a_slanted_surface_keeps_its_disparity_up_to_an_edge():
    row, column = np.mgrid[0:40, 0:60].astype(np.float32)
    step = np.where((column > 30) | (row > 20), 20, 0)
    disparity_px = (10 + 0.1 * column - 0.2 * row + step).astype(np.float32)
    result = surface_planes(disparity_px, np.ones(disparity_px.shape, bool)).disparity_px
    neighbour = (row > 5) & (row < 14) & (column > 25) & (column < 36)
    below = (column > 5) & (column < 24) & (row > 15) & (row < 26)
    for where in (neighbour, below):
        assert_allclose(result[where], disparity_px[where], atol=0.01)
