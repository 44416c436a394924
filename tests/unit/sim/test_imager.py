"""The imager: electrons by hand, exposure control, neutral values, independent noise, refusals."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.imaging import imager
from starling.sim.imaging.imager import charge, converter, noise
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.imager.exposure import Exposure, read_exposure
from starling.sim.imaging.optics import spot
from starling.sim.sensor.sensor import Imager

REAL = Imager(
    shot_noise=1.0, read_noise_e=6.0, full_well_e=8000.0, bit_depth=12, black_level_dn=20.0
)


def flat(electrons: float) -> np.ndarray:
    return np.full((300, 400), electrons, np.float32)


def read(part: Imager, electrons: np.ndarray, **changed: Any) -> np.ndarray:
    """Call `read_out` with defaults for arguments that do not matter to a test."""
    arguments: dict[str, Any] = {
        "exposure_s": 0.01,
        "unit": 0,
        "side": "left",
        "seed": 3,
        "frame": 0,
        **changed,
    }
    return imager.read_out(part, electrons, **arguments).delivered


@given(
    bits=st.sampled_from((8, 10, 12, 16)),
    dropped=st.integers(0, 8),
    share=st.floats(0, 1),
)
def test_matcher_reads_bits_that_the_image_lacks(bits, dropped, share):
    part = Imager(full_well_e=9000.0, bit_depth=bits, dropped_bits=dropped)
    level = np.full((2, 3), share * part.ceiling_dn, np.float32)
    finest = 2.0 ** -(part.matched_bits - bits)
    codes = imager.quantise_matched(part, level)
    assert part.matched_bits == min(bits + dropped, 16)
    assert codes.max() < 2**part.matched_bits
    # float32 carries 24 bits: of 16-bit codes it leaves 1/256 DN.
    assert np.abs(codes * finest - level).max() <= finest / 2 + part.ceiling_dn * 2.0**-23
    plain = dataclasses.replace(part, dropped_bits=0)
    assert np.array_equal(imager.quantise(part, level), imager.quantise(plain, level))


def test_dropped_bits_do_not_change_the_output_image():
    part = Imager(full_well_e=9000.0, bit_depth=8, read_noise_e=30.0, shot_noise=1.0)
    light = np.linspace(0, 9000, 60, dtype=np.float32).reshape(6, 10)
    arguments = {"exposure_s": 0.01, "unit": 0, "side": "left", "seed": 3, "frame": 0}
    plain = imager.read_out(part, light, **arguments)
    fine = imager.read_out(dataclasses.replace(part, dropped_bits=2), light, **arguments)
    assert plain.matched is plain.delivered
    assert np.array_equal(fine.delivered, plain.delivered)
    assert fine.matched.dtype == np.uint16
    assert np.abs(fine.matched / 4 - plain.delivered).max() <= 0.5


def test_neutral_imager_is_the_identity_up_to_its_step():
    """No noise, no pedestal: 16-bit codes are the electrons, rounded."""
    ideal = Imager(full_well_e=65535.0)
    electrons = np.linspace(0, 65535, 4096, dtype=np.float32).reshape(64, 64)
    image = read(ideal, electrons)
    assert np.abs(image - electrons).max() <= 0.51


def test_saturation_is_flat_at_the_ceiling():
    eight = dataclasses.replace(REAL, bit_depth=8)
    assert (read(eight, flat(1e6)) == 255).all()
    assert read(eight, flat(10)).dtype == np.uint8
    assert read(REAL, flat(10)).dtype == np.uint16


def test_a_full_pixel_stays_full_at_low_gain():
    """Below unit gain the pixel fills before the converter does."""
    low = dataclasses.replace(REAL, gain=0.25, shot_noise=0.0, read_noise_e=0.0)
    image = read(low, flat(1e6))
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


@pytest.mark.filterwarnings("ignore:.*exposure_s is not used without gain")
@pytest.mark.parametrize("gain", [0, -1.0, float("nan"), float("inf"), True, "1", None])
def test_only_valid_exposures_are_read_from_a_record(gain):
    assert read_exposure({"exposure_s": 0.01, "gain": gain}) is None
    assert read_exposure({"exposure_s": gain, "gain": 2}) is None
    assert read_exposure({"gain": 2}) is None
    assert read_exposure({"exposure_s": 0.01, "gain": 2}) == Exposure(exposure_s=0.01, gain=2.0)


def test_fixed_exposure_is_fixed():
    chosen = imager.choose_exposure(REAL, flat(1.0), 850.0)
    assert (chosen.exposure_s, chosen.gain) == (REAL.exposure_s, REAL.gain)


FULL = Imager(
    crosstalk=0.1,
    prnu=0.02,
    pattern_contrast=0.03,
    dark_current_e_s=500.0,
    dsnu_e=4.0,
    column_noise_e=3.0,
    row_noise_e=3.0,
    hot_pixels=1e-3,
    shot_noise=1.0,
    read_noise_e=5.0,
    blooming=0.4,
    smoothing_px=0.8,
    gamma=1.6,
    gain=2.0,
    black_level_dn=8.0,
    bit_depth=10,
)
NEUTRAL: dict[str, Any] = {  # Of what an ideal imager has not.
    "crosstalk": 0.0,
    "prnu": 0.0,
    "pattern_contrast": 0.0,
    "dark_current_e_s": 0.0,
    "dsnu_e": 0.0,
    "column_noise_e": 0.0,
    "row_noise_e": 0.0,
    "hot_pixels": 0.0,
    "shot_noise": 0.0,
    "read_noise_e": 0.0,
    "blooming": 0.0,
    "smoothing_px": 0.0,
    "gamma": 1.0,
    "black_level_dn": 0.0,
    "bit_depth": 16,
}


def scene() -> np.ndarray:
    """Dots on a dim background, some above the full well."""
    image = np.random.default_rng(5).uniform(0, 900, (90, 120)).astype(np.float32)
    image[10::20, 5::11] = 24000.0
    return image


def test_equal_arguments_give_equal_bits_and_each_of_them_counts():
    first, again = (read(FULL, scene()) for _ in range(2))
    assert np.array_equal(first, again)
    for changed in ({"seed": 4}, {"frame": 1}, {"unit": 1}, {"side": "right"}):
        assert not np.array_equal(first, read(FULL, scene(), **changed))


def test_input_light_is_not_modified():
    light = scene()
    light.setflags(write=False)
    read(FULL, light)
    assert np.array_equal(light, scene())


def test_neutral_fields_return_the_input_array():
    """The result is the input object itself, not a copy."""
    ideal, light, die = Imager(), scene(), Die(0, "left")
    assert charge.collect(ideal, light, 1.0, die) is light
    assert noise.shot_and_read(ideal, light, die=die, seed=0, frame=0) is light
    assert noise.offsets(ideal, light, die=die, seed=0, frame=0) is light
    assert charge.fill_hot_pixels(ideal, light, die) is light
    assert converter.smooth(light, 0.0) is light
    assert converter.apply_gamma(light, 1.0, 255) is light


@given(st.sets(st.sampled_from(sorted(NEUTRAL))))
def test_fields_set_to_neutral_are_the_identity(chosen: set[str]):
    """Holds for any subset of fields on an ideal imager, bit for bit."""
    moved = dataclasses.replace(Imager(), **{name: NEUTRAL[name] for name in chosen})
    assert np.array_equal(read(moved, scene()), read(Imager(), scene()))


@given(st.sets(st.sampled_from(sorted(NEUTRAL)), min_size=1))
def test_neutral_fields_do_not_change_other_fields(chosen: set[str]):
    """Neutral fields do not change the effect of other fields: no random draw moves."""
    rest = {name: value for name, value in NEUTRAL.items() if name not in chosen}
    away = {name: getattr(FULL, name) for name in rest}
    built_up = dataclasses.replace(Imager(gain=2.0), **away)
    taken_down = dataclasses.replace(FULL, **{name: NEUTRAL[name] for name in chosen})
    assert built_up == taken_down
    assert np.array_equal(read(built_up, scene()), read(taken_down, scene()))


@pytest.mark.parametrize("field", sorted(NEUTRAL))
def test_every_field_moves_the_image(field: str):
    """Each field changes the image of an otherwise ideal imager."""
    moved = dataclasses.replace(Imager(), **{field: getattr(FULL, field)})
    assert not np.array_equal(read(moved, scene()), read(Imager(), scene()))


@pytest.mark.parametrize(
    ("base", "field", "value"),
    [
        ("read_noise_e", "prnu", 0.02),
        ("read_noise_e", "dsnu_e", 4.0),
        ("read_noise_e", "row_noise_e", 4.0),
        ("row_noise_e", "column_noise_e", 4.0),
        ("row_noise_e", "shot_noise", 1.0),
        ("dsnu_e", "prnu", 0.02),
        ("prnu", "read_noise_e", 6.0),
    ],
)
def test_additional_noise_keeps_the_other_draws(base: str, field: str, value: float):
    """Subtracting the added noise's own contribution restores the image of the first noise."""
    fine = Imager(black_level_dn=20000.0)
    alone = dataclasses.replace(fine, **{base: 0.02 if base == "prnu" else 6.0})
    both = dataclasses.replace(alone, **{field: value})
    added = dataclasses.replace(fine, **{field: value})
    light = flat(2000.0)
    plain = read(fine, light).astype(np.float64)
    left = read(both, light) - (read(added, light) - plain)
    seen = np.corrcoef((left - plain).ravel(), (read(alone, light) - plain).ravel())[0, 1]
    assert seen > 0.99


def test_noises_are_independent():
    """The first rows and columns of each noise alone are pairwise uncorrelated.

    Noises with the same generator and name would be identical.
    """
    fine, light = Imager(black_level_dn=20000.0, full_well_e=1e4), flat(2000.0)
    plain = read(fine, light).astype(np.float64)

    def alone(**field: float) -> np.ndarray:
        return read(dataclasses.replace(fine, **field), light) - plain

    draws = np.stack(
        [
            alone(read_noise_e=20.0).ravel()[:300],
            alone(prnu=0.02).ravel()[:300],
            alone(dsnu_e=20.0).ravel()[:300],
            alone(row_noise_e=20.0)[:, 0],
            alone(column_noise_e=20.0)[0, :300],
        ]
    )
    assert np.abs(np.corrcoef(draws) - np.eye(len(draws))).max() < 0.25


@pytest.mark.parametrize("sigma", [0.0, 0.5, 1.2])
def test_noise_e_is_the_deviation_seen(sigma: float):
    """For a grey field and for darkness, with all noise except PRNU."""
    part = dataclasses.replace(
        FULL,
        prnu=0.0,
        pattern_contrast=0.0,
        hot_pixels=0.0,
        gamma=1.0,
        gain=1.0,
        bit_depth=16,
        smoothing_px=sigma,
        black_level_dn=3000.0,
    )
    for electrons in (0.0, 30.0, 2000.0):
        light, predicted = flat(electrons), float(imager.noise_e(part, flat(electrons), 0.05)[0, 0])
        mean = (electrons + 25.0) * part.dn_per_electron + 3000.0
        variance = np.mean(
            [
                ((read(part, light, exposure_s=0.05, unit=n, frame=n) - mean) ** 2).mean()
                for n in range(24)  # Rows and columns are few in one image.
            ]
        )
        assert np.sqrt(variance) / part.dn_per_electron == pytest.approx(predicted, rel=0.02)


def test_more_read_noise_does_not_reshuffle():
    """The draw is scaled: pixels above the mean stay above it."""
    quiet = read(REAL, flat(500)).astype(int)
    loud = dataclasses.replace(REAL, read_noise_e=30.0)
    louder = read(loud, flat(500)).astype(int)
    assert np.corrcoef(quiet.ravel(), louder.ravel())[0, 1] > 0.99


def test_blur_keeps_light_and_is_neutral_at_zero():
    image = np.zeros((65, 65), np.float32)
    image[32, 32] = 1.0
    assert spot.blur(image, 0.0) is image
    seen = spot.blur(image, 1.5)
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
        ("crosstalk", 0.6),
        ("prnu", 5.0),
        ("dark_current_e_s", -1.0),
        ("dsnu_e", float("inf")),
        ("column_noise_e", -0.1),
        ("row_noise_e", -0.1),
        ("hot_pixels", 0.5),
        ("blooming", 1.1),
        ("smoothing_px", 20.0),
        ("gamma", 0.0),
        ("black_level_dn", 1e6),
    ],
)
def test_refusals(field, value):
    with pytest.raises(InputError, match=rf"imager\.{field} must"):
        Imager(**{field: value})


def drawn(*, side: str = "left", frame: int = 0, **noise: float) -> np.ndarray:
    """Codes of uniform light, from an imager with a single kind of noise."""
    part = Imager(bit_depth=16, full_well_e=10000.0, shot_noise=0.0, read_noise_e=0.0)
    part = dataclasses.replace(part, **noise)
    light = np.full((64, 80), 3000, np.float32)
    arguments: Any = {"exposure_s": 0.01, "unit": 1, "side": side, "seed": 3, "frame": frame}
    return imager.read_out(part, light, **arguments).delivered.astype(float).ravel()


@pytest.mark.parametrize(
    "noise",
    [
        {"read_noise_e": 30.0},
        {"row_noise_e": 30.0},
        {"column_noise_e": 30.0},
        {"dsnu_e": 30.0},
        {"prnu": 0.1},
        {"shot_noise": 1.0},
    ],
)
def test_the_imagers_of_a_pair_share_no_noise(noise: dict[str, float]) -> None:
    """Common noise would look like texture at zero disparity to a matcher."""
    first, second = (drawn(side=side, **noise) for side in ("left", "right"))
    assert first.std() > 0 and abs(np.corrcoef(first, second)[0, 1]) < 0.5


def test_row_noise_is_drawn_for_each_frame() -> None:
    first, second = (drawn(frame=frame, row_noise_e=30.0) for frame in (0, 1))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.5


def test_averaging_with_gamma_is_clipped_at_the_ceiling() -> None:
    """Signals are clipped to the ceiling before averaging."""
    part = Imager(
        bit_depth=16,
        gain=1.0,
        full_well_e=65535.0,
        gamma=2.0,
        smoothing_px=1.0,
        black_level_dn=16384.0,
    )
    dot = np.zeros((31, 31), np.float32)
    dot[15, 15] = 65535.0
    share = converter.smooth((dot > 0).astype(np.float32), 1.0)[15, 15]
    most = 65535 * 0.75**2
    expected = 65535 * np.sqrt(most * share / 65535) + 16384
    assert converter.convert(part, dot).delivered[15, 15] == pytest.approx(expected, rel=2e-3)
