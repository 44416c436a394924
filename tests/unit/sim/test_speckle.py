"""Laser speckle: contrast, grain, and their relation to the optics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.imaging.optics import speckle
from starling.sim.randomness import generator
from tests.oracles.speckle import looks_in_pixel

SHAPE = (720, 1280)


def field(contrast=0.3, grain_px=0.6, *, seed=0, side="left", shape=SHAPE):
    rng = generator(seed, 0, "light", f"speckle {side}")
    return speckle.draw_speckle(shape, contrast=contrast, grain_px=grain_px, rng=rng)


def correlation(image, lag):
    off = image.astype(np.float64) - image.mean()
    return (off[:, :-lag] * off[:, lag:]).mean() / (off**2).mean()


@pytest.mark.parametrize("grain_px", [0.2, 0.6, 1.5])
@pytest.mark.parametrize("contrast", [0.05, 0.15, 0.3, 0.6])
def test_contrast_and_mean_are_as_set(contrast, grain_px):
    """Contrast is as set within 3 %, mean 1 within 0.5 %, skewness 2 C (gamma law) within 10 %.

    It does not prove that a real projector's light has a gamma law, nor which contrast it has.
    """
    image = field(contrast, grain_px).astype(np.float64)
    assert image.mean() == pytest.approx(1, abs=0.005)
    assert image.std() / image.mean() == pytest.approx(contrast, rel=0.03)
    skewness = ((image - image.mean()) ** 3).mean() / image.std() ** 3
    assert skewness == pytest.approx(2 * contrast, rel=0.1)
    assert image.min() >= 0


def test_speckle_of_one_look_is_exponential():
    """Contrast 1 is fully developed speckle: P(I > t) = exp(-t)."""
    image = field(1.0, 0.4)
    for level in (0.5, 1.0, 3.0):
        assert (image > level).mean() == pytest.approx(np.exp(-level), rel=0.02)


@pytest.mark.parametrize("contrast", [0.05, 0.6])
@pytest.mark.parametrize("grain_px", [0.86, 2.0, 5.0])
def test_grain_is_as_wide_as_the_formula_says(grain_px, contrast):
    """The autocorrelation falls to a half where a Gaussian grain averaged by a pixel does, to 10 %.

    Half widths are interpolated between whole pixels. It does not prove the Gaussian shape, for
    which `test_grain_and_contrast_follow_from_a_circular_pupil` stands.
    """
    image = field(contrast, grain_px)
    lags = np.arange(1, int(3 * grain_px) + 3)
    result = np.array([1.0, *(correlation(image, lag) for lag in lags)])
    expected = speckle._pixel_covariance(np.arange(len(result), dtype=float), grain_px)
    expected /= expected[0]

    def half_width(curve):
        return np.interp(-0.5, -curve, np.arange(len(curve)))

    assert half_width(result) == pytest.approx(half_width(expected), rel=0.1)


@pytest.mark.parametrize("f_number", [1.2, 2.0, 4.0])
def test_grain_and_contrast_follow_from_a_circular_pupil(f_number):
    """Fully developed speckle made from its physics agrees with grain, M and neighbours.

    The field of a rough surface passes a circular pupil of cut-off 1 / (2 lambda N), is squared and
    averaged over square pixels. The contrast is 1 / sqrt(M) to 3 %, the correlation of neighbours
    is met to 0.03, because a Gaussian approximates the pupil's rings. It does not prove that real
    pixels collect light evenly over their square.
    """
    wavelength_um, pitch_um, fine = 0.85, 3.0, 12
    side = 192 * fine
    rng = np.random.default_rng(5)
    rough = np.exp(2j * np.pi * rng.random((side, side)))
    frequency = np.fft.fftfreq(side, pitch_um / fine)
    radius = np.hypot(frequency[:, None], frequency[None, :])
    spectrum = np.fft.fft2(rough) * (radius < 1 / (2 * wavelength_um * f_number))
    intensity = np.abs(np.fft.ifft2(spectrum)) ** 2
    pixels = intensity.reshape(side // fine, fine, side // fine, fine).mean(axis=(1, 3))
    grain = speckle.grain_size_px(
        wavelength_nm=1e3 * wavelength_um, f_number=f_number, pixel_pitch_m=1e-6 * pitch_um
    )
    assert intensity.std() / intensity.mean() == pytest.approx(1, rel=0.03)
    looks = looks_in_pixel(grain)
    assert pixels.std() / pixels.mean() == pytest.approx(looks**-0.5, rel=0.03)
    expected = speckle._pixel_covariance(np.array([0.0, 1.0]), grain)
    assert correlation(pixels, 1) == pytest.approx(expected[1] / expected[0], abs=0.03)


def test_equal_seeds_give_equal_bits_and_imagers_differ():
    left = field()
    assert np.array_equal(left, field())
    second = field(side="right")
    assert abs(np.corrcoef(left.ravel(), second.ravel())[0, 1]) < 0.005
    assert abs(np.corrcoef(left.ravel(), field(seed=1).ravel())[0, 1]) < 0.005


@given(
    contrast=st.floats(0.01, 1.0),
    grain_px=st.floats(0.01, 8.0),
    rows=st.integers(1, 40),
    columns=st.integers(1, 40),
)
def test_any_shape_and_grain(contrast, grain_px, rows, columns):
    image = field(contrast, grain_px, shape=(rows, columns))
    assert image.shape == (rows, columns) and image.dtype == np.float32
    assert np.isfinite(image).all() and image.min() >= 0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"contrast": 0.0}, "contrast"),
        ({"contrast": 1.5}, "contrast"),
        ({"grain_px": 0.0}, "grain"),
    ],
)
def test_refusals(arguments, named):
    with pytest.raises(InputError, match=f"{named}.* must be in"):
        field(**arguments)
