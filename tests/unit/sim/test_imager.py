"""The imager against EMVA 1288: photon transfer, saturation, exposure control, determinism."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from patterns import InputError
from sim import imager, randomness
from sim.optics import blur
from sim.sensor import Imager

REAL = Imager(
    shot_noise=1.0, read_noise_e=6.0, full_well_e=8000.0, bit_depth=12, black_level_dn=20.0
)


def flat(electrons: float) -> np.ndarray:
    return np.full((300, 400), electrons, np.float32)


def rng(effect: str = "noise") -> np.random.Generator:
    return randomness.generator(3, 0, "imager", effect)


@pytest.mark.parametrize("electrons", [50.0, 500.0, 5000.0])
def test_photon_transfer(electrons):
    """Variance = K^2 (mean electrons + read^2) + 1/12, mean = K electrons + black."""
    image = imager.read_out(REAL, flat(electrons), rng()).astype(np.float64)
    gain = REAL.dn_per_electron
    assert image.mean() == pytest.approx(gain * electrons + 20.0, rel=2e-3)
    expected = gain**2 * (electrons + 6.0**2) + 1 / 12
    assert image.var() == pytest.approx(expected, rel=0.02)


def test_neutral_imager_is_the_identity_up_to_its_step():
    """No noise, no pedestal: 16-bit codes are the electrons, rounded."""
    ideal = Imager(full_well_e=65535.0)
    electrons = np.linspace(0, 65535, 4096, dtype=np.float32).reshape(64, 64)
    image = imager.read_out(ideal, electrons, rng())
    assert np.abs(image - electrons).max() <= 0.51


def test_saturation_is_flat_at_the_ceiling():
    eight = dataclasses.replace(REAL, bit_depth=8)
    assert (imager.read_out(eight, flat(1e6), rng()) == 255).all()
    assert imager.read_out(eight, flat(10), rng()).dtype == np.uint8
    assert imager.read_out(REAL, flat(10), rng()).dtype == np.uint16


def test_a_full_pixel_stays_full_at_low_gain():
    """Below unit gain the pixel fills before the converter does."""
    low = dataclasses.replace(REAL, gain=0.25, shot_noise=0.0, read_noise_e=0.0)
    image = imager.read_out(low, flat(1e6), rng())
    assert (image == low.saturation_dn).all()
    assert low.saturation_dn == round(0.25 * 4095 + 20)
    assert REAL.saturation_dn == REAL.ceiling_dn


def test_electrons_by_hand():
    """A wall of 0.01 W m^-2 sr^-1 before an f/2 lens, 3 um pixels, 8.5 ms, half the photons.

    Irradiance pi 0.01 / 16 = 1.9635e-3 W m^-2; energy 1.9635e-3 * 9e-12 * 8.5e-3 = 1.50208e-16 J;
    a photon of 850 nm has 2.33700e-19 J: 642.74 photons, 321.37 electrons.
    """
    part = Imager(quantum_efficiency=0.5, pixel_pitch_m=3e-6)
    electrons = 0.01 * imager.electrons_per_radiance(part, 850.0, 8.5e-3)
    assert electrons == pytest.approx(321.37, rel=1e-4)


@given(st.floats(1e-4, 1e2))
def test_auto_exposure_meets_its_level_or_its_limit(radiance):
    part = dataclasses.replace(REAL, auto_exposure_level=0.25)
    image = np.full((8, 8), radiance, np.float32)
    chosen = imager.control(part, image, 850.0)
    electrons = imager.mean_electrons(part, image, 850.0, chosen)
    level = float(electrons.mean()) * part.dn_per_electron + part.black_level_dn
    at_limit = chosen.exposure_s == part.auto_exposure_max_s
    assert at_limit or level == pytest.approx(0.25 * part.ceiling_dn, rel=1e-4)
    assert level <= 0.25 * part.ceiling_dn * (1 + 1e-4)


def test_fixed_exposure_is_fixed():
    chosen = imager.control(REAL, flat(1.0), 850.0)
    assert (chosen.exposure_s, chosen.gain) == (REAL.exposure_s, REAL.gain)


def test_equal_seeds_give_equal_bits_and_effects_do_not_share_numbers():
    first, again = (imager.read_out(REAL, flat(500), rng()) for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, imager.read_out(REAL, flat(500), rng("other")))


def test_more_read_noise_does_not_reshuffle():
    """The same draw, scaled: what is above the mean stays above it."""
    quiet = imager.read_out(REAL, flat(500), rng()).astype(int)
    loud = dataclasses.replace(REAL, read_noise_e=30.0)
    louder = imager.read_out(loud, flat(500), rng()).astype(int)
    assert np.corrcoef(quiet.ravel(), louder.ravel())[0, 1] > 0.99


def test_blur_keeps_light_and_is_neutral_at_zero():
    image = np.zeros((65, 65), np.float32)
    image[32, 32] = 1.0
    assert blur.blur(image, 0.0) is image
    seen = blur.blur(image, 1.5)
    assert seen.sum() == pytest.approx(1.0, rel=1e-5)
    columns = np.arange(65) - 32
    assert float((seen.sum(axis=0) * columns**2).sum()) == pytest.approx(1.5**2, rel=0.02)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("exposure_s", 0.0),
        ("gain", -1.0),
        ("full_well_e", float("nan")),
        ("quantum_efficiency", 1.2),
        ("auto_exposure_level", 1.0),
        ("shot_noise", 2.0),
        ("read_noise_e", -1.0),
        ("bit_depth", 9),
        ("black_level_dn", 1e6),
    ],
)
def test_refusals(field, value):
    with pytest.raises(InputError, match=rf"imager\.{field} must"):
        Imager(**{field: value})
