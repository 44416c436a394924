"""The field of view: solid angle, conversions, uniform directions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.patterns import Field, InputError


def test_a_right_angled_field_is_a_sixth_of_the_sphere():
    sphere_deg2 = 4 * math.pi * math.degrees(1) ** 2
    assert Field(90.0, 90.0).solid_angle_deg2 == pytest.approx(sphere_deg2 / 6)


def test_a_small_field_is_the_product_of_its_angles():
    assert Field(1.0, 2.0).solid_angle_deg2 == pytest.approx(2.0, rel=1e-3)


@settings(deadline=None, max_examples=50)
@given(
    fov_x=st.floats(10, 120),
    fov_y=st.floats(10, 120),
    x=st.floats(-2, 2),
    y=st.floats(-2, 2),
)
def test_pixels_and_tangents_invert_each_other(fov_x, fov_y, x, y):
    field = Field(fov_x, fov_y)
    pixels = field.pixels(np.array([x]), np.array([y]), (300, 400))
    back = field.tangents(*pixels, (300, 400))
    np.testing.assert_allclose(np.ravel(back), [x, y], atol=1e-9)


def test_the_axis_is_central_and_the_edge_half_a_pixel_outside():
    field = Field(60.0, 40.0)
    x, y = field.pixels(np.array([0.0, field.half_x]), np.array([0.0, field.half_y]), (100, 200))
    np.testing.assert_allclose(x, [99.5, 199.5])
    np.testing.assert_allclose(y, [49.5, 99.5])


def test_pixels_are_square():
    field = Field(67.0, 41.0)
    shape = field.shape(1280)
    assert shape == (723, 1280)
    focal_x, focal_y = field.focal_px(shape)
    assert focal_x == pytest.approx(focal_y, rel=1e-3)


def test_uniform_directions_fill_equal_solid_angles_equally():
    """The share of directions in a field of half the angles equals its solid angle, to 4 sigma."""
    field, inner = Field(90.0, 63.0), Field(45.0, 31.5)
    n = 40_000
    x, y = field.uniform_directions(n, np.random.default_rng(0))
    assert len(x) == n and field.holds(x, y).all()
    share = inner.solid_angle_deg2 / field.solid_angle_deg2
    assert inner.holds(x, y).mean() == pytest.approx(share, abs=4 * math.sqrt(share / n))


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: Field(0.0, 40.0), r"fov_x_deg must be in \[1, 150\]; got 0\.0\. Give the full"),
        (lambda: Field(60.0, math.nan), r"fov_y_deg must be in \[1, 150\]; got nan\."),
        (lambda: Field(60.0, 180.0), r"fov_y_deg must be in .*; got 180\.0\."),
        (lambda: Field(60.0, 40.0).shape(1280.0), r"width_px must be an integer in .*1280\.0\."),  # type: ignore
        (lambda: Field(60.0, 40.0).shape(True), r"width_px must be an integer in .*; got True\."),
        (lambda: Field(60.0, 40.0).shape(16), r"width_px must be an integer in \[32, 8192\]; got"),
        (lambda: Field(150.0, 2.0).shape(640), r"image height must be an integer in .*; got 3\."),
    ],
)
def test_refusals(act, message):
    with pytest.raises(InputError, match=message):
        act()
