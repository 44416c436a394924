"""Drawing of dots: position, width, power."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.patterns import Field, InputError, draw
from tests.oracles.pattern_statistics import measure

FIELD = Field(60.0, 40.0)
SHAPE = FIELD.shape(320)


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(80, 240),
    y=st.floats(60, 140),
    power=st.floats(0.01, 100),
    fwhm=st.floats(6.0, 30.0),
)
def test_a_spot_keeps_its_energy_and_place(x, y, power, fwhm):
    image = draw(np.array([[x, y, power]]), SHAPE, FIELD, fwhm)
    assert image.sum() == pytest.approx(power, rel=1e-5)
    rows, columns = np.indices(SHAPE)
    assert (image * columns).sum() / power == pytest.approx(x, abs=0.02)
    assert (image * rows).sum() / power == pytest.approx(y, abs=0.02)


def test_energy_of_many_dots_is_the_sum_of_their_powers():
    rng = np.random.default_rng(0)
    dots = np.stack([rng.uniform(40, 280, 500), rng.uniform(40, 170, 500), rng.random(500)], 1)
    assert draw(dots, SHAPE, FIELD, 8.0).sum() == pytest.approx(dots[:, 2].sum(), rel=1e-5)


def test_a_dot_on_the_edge_loses_half():
    x, y = -0.5, (SHAPE[0] - 1) / 2
    assert draw(np.array([[x, y, 1.0]]), SHAPE, FIELD, 20.0).sum() == pytest.approx(0.5, abs=0.01)


def test_dots_far_outside_leave_nothing():
    assert draw(np.array([[1e9, -1e9, 1.0], [-900, 50, 1.0]]), SHAPE, FIELD, 8.0).sum() == 0


def test_drawing_is_linear_in_the_dots():
    rng = np.random.default_rng(1)
    dots = np.stack([rng.uniform(0, 320, 60), rng.uniform(0, 200, 60), rng.random(60)], 1)
    parts = draw(dots[:30], SHAPE, FIELD, 9.0) + draw(dots[30:], SHAPE, FIELD, 9.0)
    np.testing.assert_allclose(draw(dots, SHAPE, FIELD, 9.0), parts, atol=1e-9)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 38.0])
def test_a_spot_grows_on_the_plane_as_its_cosines_project(angle_deg):
    """Widths grow by 1/cos^3 radially and 1/cos tangentially, with sigma = FWHM / 2.355."""
    field = Field(90.0, 30.0)
    shape = field.shape(1600)
    focal = field.focal_px(shape)[0]
    tangent = math.tan(math.radians(angle_deg))
    x, y = tangent * focal + (shape[1] - 1) / 2, (shape[0] - 1) / 2
    image = draw(np.array([[x, y, 1.0]]), shape, field, 10.0)
    rows, columns = np.indices(shape)
    sigma = 10e-3 / math.sqrt(8 * math.log(2)) * focal
    cos = math.cos(math.radians(angle_deg))
    along = math.sqrt((image * (columns - x) ** 2).sum())
    across = math.sqrt((image * (rows - y) ** 2).sum())
    assert along == pytest.approx(sigma / cos**3, rel=0.005)
    assert across == pytest.approx(sigma / cos, rel=0.005)


def test_a_spot_off_both_axes_keeps_its_width_in_cosines():
    field = Field(90.0, 80.0)
    shape = field.shape(900)
    dot = np.array([[820.0, 690.0, 1.0]])
    measured = measure(draw(dot, shape, field, 9.0), fov_x_deg=90.0, fov_y_deg=80.0)
    assert measured.dots == 1
    assert measured.fwhm_mrad == pytest.approx(9.0, rel=0.01)


@pytest.mark.parametrize(
    ("dots", "fwhm", "message"),
    [
        (np.ones((3, 2)), 8.0, r"dots must have shape \(n, 3\); got \(3, 2\)\. Give x_px"),
        (np.array([[1, 2, 1], [1, 2, -1.0]]), 8.0, r"dots must be finite .* first at row 1\."),
        (np.array([[np.nan, 2, 1.0]]), 8.0, r"dots must be finite with power >= 0; got 1 others"),
        (np.ones((1, 3)), 0.0, r"fwhm_mrad must be > 0; got 0\.0\."),
        (np.ones((1, 3)), 1.0, r"fwhm_mrad must span 1\.5 px to .*; got 1 mrad = 0\.28 px\."),
        (np.ones((1, 3)), 500.0, r"fwhm_mrad must span .*; got 500 mrad = "),
    ],
)
def test_refusals(dots, fwhm, message):
    with pytest.raises(InputError, match=message):
        draw(dots, SHAPE, FIELD, fwhm)
