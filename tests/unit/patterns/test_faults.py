"""Dark, displaced and wider dots of a pattern, and what they do to its light."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError, Pattern, faults, lattice, quasirandom
from starling.patterns.field import Field, unit_vectors

PATTERN = quasirandom(width_px=960)
BACKGROUND = 0.3


def irradiance(pattern=PATTERN, seed=0, **what):
    return faults.irradiance(pattern, rng=np.random.default_rng(seed), **what)


def of_one_dot(x, y, *, fov_x_deg=90.0, fov_y_deg=63.0, width_px=1920, fwhm_mrad=4.0):
    """A pattern of one dot at tangents (x, y), no background."""
    return Pattern.of_dots(
        np.array([x]),
        np.array([y]),
        np.ones(1),
        field=Field(fov_x_deg, fov_y_deg),
        width_px=width_px,
        fwhm_mrad=fwhm_mrad,
        background=0.0,
        name="one dot",
    )


def dots_of(pattern):
    assert pattern.dots is not None
    return pattern.dots


def deviation(image, field):
    """Standard deviations [1e-3] of the light along both direction cosines."""
    rows, columns = np.nonzero(image > image.max() * 1e-6)
    x, y = field.tangents(columns.astype(float), rows.astype(float), image.shape)
    cosines = unit_vectors(x, y)[:, :2]
    weight = image[rows, columns].astype(float)
    off = cosines - weight @ cosines / weight.sum()
    return 1e3 * np.sqrt(weight @ off**2 / weight.sum())


def test_no_fault_leaves_the_very_image():
    assert irradiance() is PATTERN.image


@pytest.mark.parametrize("dropped", [0.1, 0.5, 0.9])
def test_dropped_dots_take_their_light_and_nothing_else(dropped):
    """Rationale: a dark emitter or order leaves all other light as it is.

    Expected: the mean falls by the share of the dropped dots' power, whose deviation is that of
    a binomial draw; away from dropped dots the bits stay. It does not prove that real dots fail
    independently of each other, nor that their share of the even light stays.
    """
    made = irradiance(dropped=dropped)
    lost = (1 - made.mean(dtype=np.float64)) / (1 - BACKGROUND)
    power = dots_of(PATTERN)[:, 2]
    deviation = np.sqrt(dropped * (1 - dropped) * (power**2).sum()) / power.sum()
    assert lost == pytest.approx(dropped, abs=4 * deviation)
    assert (made <= PATTERN.image).all()
    few = irradiance(dropped=0.01)
    assert 0 < (few != PATTERN.image).mean() < 0.05


def test_more_dropped_dots_include_the_fewer():
    fewer, more = (irradiance(dropped=share) for share in (0.2, 0.4))
    assert (more <= fewer).all()


def test_another_draw_drops_other_dots():
    assert not np.array_equal(irradiance(dropped=0.2), irradiance(dropped=0.2, seed=1))


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.7, 0.4)])
def test_shifted_dots_move_by_the_set_angle(x, y):
    """Displacements over 400 draws have the set deviation on each axis, wherever the dot is.

    Tolerance: four deviations of an estimate from 800 numbers. It does not prove that real
    displacements are normal or independent.
    """
    pattern = of_one_dot(x, y, width_px=480, fwhm_mrad=12.0)
    field, sigma = pattern.field, 3.0
    home = unit_vectors(np.array([x]), np.array([y]))[0]
    off = []
    for seed in range(400):
        dots = dots_of(pattern).copy()
        step = np.random.default_rng(seed).standard_normal((2, 1)) * sigma * 1e-3
        faults._displace(dots, step, pattern)
        ray = unit_vectors(*field.tangents(dots[:, 0], dots[:, 1], pattern.shape))[0]
        off.append(ray - home)
    found = 1e3 * np.sqrt((np.array(off) ** 2).sum(axis=1).mean() / 2)
    assert found == pytest.approx(sigma, rel=4 / np.sqrt(2 * 800))


def test_a_shifted_dot_is_drawn_where_it_went():
    pattern = of_one_dot(0.2, -0.1)
    made = irradiance(pattern, shifted_mrad=5.0)
    rows, columns = np.indices(made.shape)
    weight = made / made.sum(dtype=np.float64)
    rng = np.random.default_rng(0)
    rng.random(1)
    dots = dots_of(pattern).copy()
    faults._displace(dots, rng.standard_normal((2, 1)) * 5e-3, pattern)
    assert (weight * columns).sum() == pytest.approx(dots[0, 0], abs=0.05)
    assert (weight * rows).sum() == pytest.approx(dots[0, 1], abs=0.05)
    assert made.mean(dtype=np.float64) == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("widened", [0.5, 1.5, 4.0, 12.0])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.55, 0.3)])
def test_widths_add_in_quadrature_across_the_field(x, y, widened):
    """A dot of sigma s widened by w has sqrt(s^2 + w^2), in the middle and off the axis.

    Tolerance 2 %. It does not prove that a real lens's spot is a Gaussian.
    """
    pattern = of_one_dot(x, y)
    made = irradiance(pattern, widened_mrad=widened)
    expected = np.hypot(4.0 / np.sqrt(8 * np.log(2)), widened)
    assert deviation(made, pattern.field) == pytest.approx(expected, rel=0.02)
    assert made.mean(dtype=np.float64) == pytest.approx(1, rel=1e-3)  # No light is lost.


@pytest.mark.parametrize("widened", [2.0, 4.0])
@pytest.mark.parametrize("x", [0.0, 0.3, 0.6])
def test_an_image_is_blurred_evenly_in_cosines(x, widened):
    """A pattern that is but an image widens by what was set to 5 % in the middle 60 %.

    It does not prove it for blurs under two pixels, where interpolation counts (6 % at one).
    """
    drawn = of_one_dot(x, 0.35 * x)
    image = Pattern.of_image(drawn.image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph")
    made = irradiance(image, widened_mrad=widened)
    before, after = (deviation(p, image.field) for p in (drawn.image, made))
    assert np.sqrt(after**2 - before**2) == pytest.approx(widened, rel=0.05)
    assert made.mean(dtype=np.float64) == pytest.approx(1, rel=2e-3)


def test_a_hardly_blurred_image_is_hardly_another():
    """Continuity at neutral: a hundredth of a pixel's blur changes a dot's peak by under 1 %."""
    image = Pattern.of_image(
        of_one_dot(0.1, 0.1).image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph"
    )
    made = irradiance(image, widened_mrad=0.01)
    assert made.max() == pytest.approx(image.image.max(), rel=0.01)


@given(dropped=st.floats(0, 0.99), shifted=st.floats(0, 20), widened=st.floats(0, 5))
def test_faults_make_no_light(dropped, shifted, widened):
    pattern = lattice(width_px=480, pitch_mrad=40.0, fwhm_mrad=10.0)
    made = irradiance(pattern, dropped=dropped, shifted_mrad=shifted, widened_mrad=widened, seed=2)
    assert made.dtype == np.float32 and made.shape == pattern.shape
    assert made.min() >= 0
    # Dots come in from beyond the edge no more than they go out.
    assert made.mean(dtype=np.float64) <= 1 + 1e-3


def test_refusals():
    image = Pattern.of_image(PATTERN.image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph")
    unknown = r"pattern must know its dots .* got photograph"
    with pytest.raises(InputError, match=unknown):
        irradiance(image, dropped=0.1)
    with pytest.raises(InputError, match=unknown):
        irradiance(image, shifted_mrad=1.0)
    with pytest.raises(InputError, match="spot must be at most a quarter of the pattern wide"):
        irradiance(of_one_dot(0, 0, fov_x_deg=10.0, fov_y_deg=8.0), widened_mrad=50.0)
    with pytest.raises(InputError, match="dropped must be in"):
        irradiance(dropped=1.0)
    with pytest.raises(InputError, match="shifted_mrad must be in"):
        irradiance(shifted_mrad=-0.1)
    with pytest.raises(InputError, match="widened_mrad must be in"):
        irradiance(widened_mrad=float("nan"))
