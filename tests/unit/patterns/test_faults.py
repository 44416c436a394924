"""Dark, displaced and widened dots, and their effect on the pattern's light."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError, Pattern, faults, lattice, quasirandom
from starling.patterns.field import Field, unit_vectors

PATTERN = quasirandom(width_px=960)
BACKGROUND = 0.3


def irradiance(pattern=PATTERN, seed=0, **options):
    return faults.irradiance(pattern, rng=np.random.default_rng(seed), **options)


def of_one_dot(x, y, *, fov_x_deg=90.0, fov_y_deg=63.0, width_px=1920, fwhm_mrad=4.0):
    """A pattern of one dot at tangents (x, y), no background."""
    return Pattern.from_dots(
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


def test_no_fault_returns_the_same_image():
    assert irradiance() is PATTERN.image


@pytest.mark.parametrize("dropped", [0.1, 0.5, 0.9])
def test_dropped_dots_lose_only_their_own_light(dropped):
    """A dark emitter or order does not change other light.

    Expected: the mean falls by the power of the dropped dots, with binomial variance. Away from
    dropped dots the bits are equal. The test does not show that real dots fail independently, nor
    that their share of the background remains.
    """
    faulty = irradiance(dropped=dropped)
    lost = (1 - faulty.mean(dtype=np.float64)) / (1 - BACKGROUND)
    power = dots_of(PATTERN)[:, 2]
    deviation = np.sqrt(dropped * (1 - dropped) * (power**2).sum()) / power.sum()
    assert lost == pytest.approx(dropped, abs=4 * deviation)
    assert (faulty <= PATTERN.image).all()
    few = irradiance(dropped=0.01)
    assert 0 < (few != PATTERN.image).mean() < 0.05


def test_more_dropped_dots_include_the_fewer():
    fewer, more = (irradiance(dropped=share) for share in (0.2, 0.4))
    assert (more <= fewer).all()


def test_another_seed_drops_other_dots():
    assert not np.array_equal(irradiance(dropped=0.2), irradiance(dropped=0.2, seed=1))


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.7, 0.4)])
def test_shifted_dots_move_by_the_set_angle(x, y):
    """Displacements over 400 draws have the specified deviation on each axis, at all positions.

    Tolerance: four deviations of an estimate from 800 numbers. The test does not show that real
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
    measured = 1e3 * np.sqrt((np.array(off) ** 2).sum(axis=1).mean() / 2)
    assert measured == pytest.approx(sigma, rel=4 / np.sqrt(2 * 800))


def test_a_shifted_dot_is_drawn_at_its_new_position():
    pattern = of_one_dot(0.2, -0.1)
    faulty = irradiance(pattern, shifted_mrad=5.0)
    rows, columns = np.indices(faulty.shape)
    weight = faulty / faulty.sum(dtype=np.float64)
    rng = np.random.default_rng(0)
    rng.random(1)
    dots = dots_of(pattern).copy()
    faults._displace(dots, rng.standard_normal((2, 1)) * 5e-3, pattern)
    assert (weight * columns).sum() == pytest.approx(dots[0, 0], abs=0.05)
    assert (weight * rows).sum() == pytest.approx(dots[0, 1], abs=0.05)
    assert faulty.mean(dtype=np.float64) == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("widened", [0.5, 1.5, 4.0, 12.0])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.55, 0.3)])
def test_widths_add_in_quadrature_across_the_field(x, y, widened):
    """A dot of sigma s widened by w has sqrt(s^2 + w^2), in the middle and off the axis.

    Tolerance: 2 %. The test does not show that a real lens's spot is Gaussian.
    """
    pattern = of_one_dot(x, y)
    faulty = irradiance(pattern, widened_mrad=widened)
    expected = np.hypot(4.0 / np.sqrt(8 * np.log(2)), widened)
    assert deviation(faulty, pattern.field) == pytest.approx(expected, rel=0.02)
    assert faulty.mean(dtype=np.float64) == pytest.approx(1, rel=1e-3)  # No light is lost.


@pytest.mark.parametrize("widened", [2.0, 4.0])
@pytest.mark.parametrize("x", [0.0, 0.3, 0.6])
def test_an_image_is_blurred_evenly_in_cosines(x, widened):
    """A pattern without a dot list widens as specified, to 5 % in the central 60 %.

    The test excludes blurs under two pixels, where interpolation matters (6 % at one pixel).
    """
    drawn = of_one_dot(x, 0.35 * x)
    image = Pattern.from_image(drawn.image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph")
    faulty = irradiance(image, widened_mrad=widened)
    before, after = (deviation(p, image.field) for p in (drawn.image, faulty))
    assert np.sqrt(after**2 - before**2) == pytest.approx(widened, rel=0.05)
    assert faulty.mean(dtype=np.float64) == pytest.approx(1, rel=2e-3)


def test_a_tiny_blur_hardly_changes_an_image():
    """Continuity at neutral: a blur of 0.01 px changes a dot's peak by less than 1 %."""
    image = Pattern.from_image(
        of_one_dot(0.1, 0.1).image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph"
    )
    faulty = irradiance(image, widened_mrad=0.01)
    assert faulty.max() == pytest.approx(image.image.max(), rel=0.01)


@given(dropped=st.floats(0, 0.99), shifted=st.floats(0, 20), widened=st.floats(0, 5))
def test_faults_add_no_light(dropped, shifted, widened):
    pattern = lattice(width_px=480, pitch_mrad=40.0, fwhm_mrad=10.0)
    faulty = irradiance(
        pattern, dropped=dropped, shifted_mrad=shifted, widened_mrad=widened, seed=2
    )
    assert faulty.dtype == np.float32 and faulty.shape == pattern.shape
    assert faulty.min() >= 0
    # Displacement brings no more light in from outside the field than it removes.
    assert faulty.mean(dtype=np.float64) <= 1 + 1e-3


def test_refusals():
    image = Pattern.from_image(PATTERN.image, fov_x_deg=90.0, fov_y_deg=63.0, name="photograph")
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
