"""Laws of the imager's electronics, measured by the methods of EMVA 1288."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.sim.imaging import imager
from starling.sim.imaging.imager import charge, converter
from starling.sim.imaging.imager.charge import Die
from starling.sim.sensor.sensor import Imager

SHAPE = (240, 320)
FINE = Imager(full_well_e=10000.0, black_level_dn=6000.0)  # 6.55 DN per electron.


def read(part: Imager, light: np.ndarray | float, **changed: Any) -> np.ndarray:
    """Read out an image in DN, as float64, with defaults for irrelevant arguments."""
    electrons = np.broadcast_to(np.float32(light), SHAPE) if np.isscalar(light) else light
    chosen: dict[str, Any] = {
        "exposure_s": 0.01,
        "unit": 0,
        "side": "left",
        "seed": 0,
        "frame": 0,
        **changed,
    }
    return imager.read_out(part, np.ascontiguousarray(electrons), **chosen).delivered.astype(
        np.float64
    )


def average_e(part: Imager, light: np.ndarray | float, frames: int, **changed: Any) -> np.ndarray:
    """Mean of frames in electrons above black."""
    total = sum(read(part, light, frame=n, **changed) for n in range(frames))
    return (total / frames - part.black_level_dn) / part.dn_per_electron


@pytest.mark.parametrize("bit_depth", [8, 10, 12])
@pytest.mark.parametrize("gain", [1.0, 4.0])
@pytest.mark.parametrize("read_noise_e", [12.0, 30.0])
def test_photon_transfer(bit_depth: int, gain: float, read_noise_e: float):
    """Temporal variance against mean: the slope is the gain, the intercept the read noise.

    Pairs of frames at levels from 2 to 45 % of full scale; variance = half that of their
    difference, less the converter's 1/12; K = slope, read noise = sqrt(intercept) / K, both to
    2 %. Source: EMVA 1288, release 4.0, photon transfer method.

    Does not prove that a device has such numbers, nor that noise is white. With a read noise below
    a quarter of a step, the converter's variance would differ from 1/12.
    """
    part = Imager(
        shot_noise=1.0,
        read_noise_e=read_noise_e,
        full_well_e=8000.0,
        gain=gain,
        bit_depth=bit_depth,
        black_level_dn=0.1 * 2**bit_depth,
    )
    means, variances = [], []
    for number, share in enumerate(np.linspace(0.02, 0.45, 12)):
        light = share / gain * part.full_well_e
        for pair in range(8):
            first = read(part, light, seed=number, frame=2 * pair)
            second = read(part, light, seed=number, frame=2 * pair + 1)
            means.append((first.mean() + second.mean()) / 2 - part.black_level_dn)
            variances.append((first - second).var() / 2 - 1 / 12)
    weights = 1 / np.array(variances)  # Standard deviation of the estimated variance.
    slope, intercept = np.polyfit(means, variances, 1, w=weights)
    assert slope == pytest.approx(part.dn_per_electron, rel=0.02)
    assert np.sqrt(intercept) / slope == pytest.approx(read_noise_e, rel=0.02)


@pytest.mark.parametrize("electrons", [2.0, 8.0, 40.0])
def test_few_electrons_have_poisson_skewness(electrons: float):
    """Mean, variance and third moment of Poisson counts plus Gaussian read noise of 1.5 electrons.

    A normal distribution has third moment 0 and would fail. Does not prove the full distribution,
    since whole electrons are not resolved.
    """
    part = dataclasses.replace(FINE, shot_noise=1.0, read_noise_e=1.5)
    seen = np.stack([read(part, electrons, frame=n) for n in range(16)])
    deviation = (seen - part.black_level_dn) / part.dn_per_electron - electrons
    assert deviation.mean() == pytest.approx(0.0, abs=0.01 * np.sqrt(electrons))
    assert deviation.var() == pytest.approx(electrons + 1.5**2, rel=0.01)
    assert (deviation**3).mean() == pytest.approx(electrons, rel=0.08)


@pytest.mark.parametrize("prnu", [0.005, 0.02])
def test_prnu_is_specific_to_a_device(prnu: float):
    """Deviation over mean of a frame average = PRNU to 3 %, proportional to the signal.

    The pattern is the same in other captures and at another level. It differs in the other imager
    and in another unit. The residual temporal noise of the average is subtracted. Does not prove
    that real sensitivities are Gaussian or white over the image.
    """
    part = dataclasses.replace(FINE, shot_noise=1.0, read_noise_e=3.0, prnu=prnu)
    frames = 64

    def pattern(light: float, **changed: Any) -> np.ndarray:
        return average_e(part, light, frames, **changed) / light - 1

    bright = pattern(6000.0)
    residual = (6000.0 + 3.0**2) / frames / 6000.0**2
    assert np.sqrt(bright.var() - residual) == pytest.approx(prnu, rel=0.03)
    again = pattern(3000.0, seed=9)
    assert np.mean(bright * again) == pytest.approx(prnu**2, rel=0.03)
    for device in ({"side": "right"}, {"unit": 1, "seed": 5}):
        assert abs(np.corrcoef(bright.ravel(), pattern(6000.0, **device).ravel())[0, 1]) < 0.02


def test_dark_frames_give_dark_current_and_dsnu():
    """Mean = dark current x time, temporal variance = the same count, DSNU to 3 % and fixed.

    Does not cover temperature, which is not modelled.
    """
    part = dataclasses.replace(FINE, shot_noise=1.0, dark_current_e_s=2000.0, dsnu_e=5.0)
    frames = 48
    for exposure_s in (0.01, 0.03):
        dark_e = 2000.0 * exposure_s
        mean = average_e(part, 0.0, frames, exposure_s=exposure_s)
        pair = read(part, 0.0, exposure_s=exposure_s) - read(
            part, 0.0, exposure_s=exposure_s, frame=1
        )
        # The mean of 76800 offsets deviates by 5 / sqrt(76800) = 0.018 electrons.
        assert mean.mean() == pytest.approx(dark_e, abs=0.1)
        assert pair.var() / 2 / part.dn_per_electron**2 == pytest.approx(dark_e, rel=0.03)
        assert np.sqrt(mean.var() - dark_e / frames) == pytest.approx(5.0, rel=0.03)


def test_rows_change_with_the_frame_and_columns_stay():
    """Offsets are constant along a line, with the set deviation (5 %).

    Rows change with each frame, columns never.

    Does not prove that a device's rows are independent of each other (mains hum is not).
    """
    rows = dataclasses.replace(FINE, row_noise_e=4.0)
    columns = dataclasses.replace(FINE, column_noise_e=4.0)
    by_row = np.stack([read(rows, 1000.0, frame=n) for n in range(16)])
    by_column = np.stack([read(columns, 1000.0, frame=n, seed=n) for n in range(16)])
    assert (by_row == by_row[..., :1]).all()
    assert (by_column == by_column[:1, :1, :]).all()
    step = rows.dn_per_electron
    assert by_row[..., 0].std() / step == pytest.approx(4.0, rel=0.05)
    units = np.stack([read(columns, 1000.0, unit=n)[0] for n in range(16)])
    assert units.std() / step == pytest.approx(4.0, rel=0.05)
    frames = np.corrcoef(by_row[:, :, 0])
    assert np.abs(frames - np.eye(16)).max() < 0.3  # 4.6 deviations of 1 / sqrt(240).


def test_hot_pixels_are_binomial_fixed_and_full():
    """Hot pixels: n p within 4 deviations, equal in all captures, all at the ceiling."""
    part = dataclasses.replace(FINE, hot_pixels=1e-3)
    n, p = SHAPE[0] * SHAPE[1], 1e-3
    counts = []
    for unit in range(12):
        full = read(part, 100.0, unit=unit) == part.ceiling_dn
        assert np.array_equal(full, read(part, 500.0, unit=unit, seed=4) == part.ceiling_dn)
        counts.append(full.sum())
    deviation = np.sqrt(n * p * (1 - p))
    assert np.abs(np.array(counts) - n * p).max() < 4 * deviation
    assert np.std(counts) == pytest.approx(deviation, rel=0.6)  # Chi-squared with 11 degrees.
    more = dataclasses.replace(part, hot_pixels=2e-3)
    fewer = read(part, 100.0) == part.ceiling_dn
    assert (read(more, 100.0) == part.ceiling_dn)[fewer].all()


@given(st.floats(0.01, 0.5))
def test_crosstalk_is_a_kernel_of_sum_one(share: float):
    """A lit pixel keeps 1 - c and gives c / 4 to each neighbour; totals are conserved.

    A signal's correlation over one pixel is that of the kernel: (c/2)(1-c) over its square sum.
    Does not prove that a real pixel's neighbours have equal shares (microlenses, deep trenches).
    """
    point = np.zeros((9, 9), np.float32)
    point[4, 4] = 1.0
    seen = charge.crosstalk(point, share)
    assert seen[4, 4] == pytest.approx(1 - share, rel=1e-6)
    assert seen[[3, 5, 4, 4], [4, 4, 3, 5]] == pytest.approx(share / 4, rel=1e-6)
    white = np.random.default_rng(0).standard_normal((400, 400)).astype(np.float32)
    mixed = charge.crosstalk(white, share)
    assert mixed.sum(dtype=np.float64) == pytest.approx(white.sum(dtype=np.float64), abs=0.05)
    correlation = np.corrcoef(mixed[:, 1:].ravel(), mixed[:, :-1].ravel())[0, 1]
    square = (1 - share) ** 2 + share**2 / 4
    assert correlation == pytest.approx(share / 2 * (1 - share) / square, abs=0.012)


def test_crosstalk_leaves_noise_independent():
    """Crosstalk acts before photon counting: neighbours' shot noise is uncorrelated."""
    part = dataclasses.replace(FINE, shot_noise=1.0, crosstalk=0.4)
    image = read(part, 2000.0)
    assert abs(np.corrcoef(image[:, 1:].ravel(), image[:, :-1].ravel())[0, 1]) < 0.015


@settings(max_examples=50)
@given(st.floats(0.05, 1.0), st.integers(0, 2**32 - 1))
def test_blooming_accounts_for_the_charge(share: float, seed: int):
    """Stored = total - drained; columns are independent; no pixel exceeds full well.

    The columns have enough room at their ends. Does not prove the streak's profile, since a real
    drain takes charge at each pixel.
    """
    rng = np.random.default_rng(seed)
    part = Imager(blooming=share, full_well_e=1000.0)
    light = np.full((200, 12), 100.0, np.float32)
    light[90:110, 2:10] = rng.uniform(0, 3000, (20, 8)).astype(np.float32)
    stored = charge.limit_to_full_well(part, light)
    excess = np.maximum(light - 1000, 0).sum(axis=0, dtype=np.float64)
    total = light.sum(axis=0, dtype=np.float64)
    assert stored.sum(axis=0, dtype=np.float64) == pytest.approx(
        total - (1 - share) * excess, rel=1e-5
    )
    assert stored.max() <= 1000.0
    assert (stored >= np.minimum(light, 1000.0)).all()
    assert (stored[:, :2] == 100.0).all() and (stored[:, 10:] == 100.0).all()


def test_blooming_fills_pixel_after_pixel():
    """By hand: 5000 electrons in a well of 1000; half of the excess of 4000 goes each way.

    The neighbours hold 100. 2000 electrons fill 900 + 900 + 200 of three neighbours. Towards an
    end two pixels away, 1800 are stored and 200 leave the image.
    """
    light = np.full((9, 1), 100.0, np.float32)
    light[2] = 5000.0
    stored = charge.limit_to_full_well(Imager(blooming=1.0, full_well_e=1000.0), light)[:, 0]
    assert stored.tolist() == [1000, 1000, 1000, 1000, 1000, 300, 100, 100, 100]
    none = charge.limit_to_full_well(Imager(full_well_e=1000.0), light)[:, 0]
    assert none.tolist() == [100, 100, 1000, 100, 100, 100, 100, 100, 100]


@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.5])
def test_smoothing_lowers_and_correlates_noise(sigma: float):
    """Variance x 1 / (4 pi sigma^2), autocorrelation exp(-d^2 / (4 sigma^2)), mean kept.

    To 2 % and 0.01. Poisson's sum formula gives what a kernel of whole pixels changes, with
    q = exp(-pi^2 sigma^2): (1 + 2 q)^2 times the variance, 3.2 % more at 0.7 px and 0.02 % at 1 px;
    (1 - 2 q) / (1 + 2 q) times the correlation over odd distances. Does not prove that a device
    resamples so: bilinear rectification averages differently from pixel to pixel.
    """
    part = dataclasses.replace(FINE, read_noise_e=20.0, smoothing_px=sigma)
    seen = np.stack([read(part, 1000.0, frame=n) for n in range(16)]) - part.black_level_dn
    deviation = seen / part.dn_per_electron - 1000.0
    variance = deviation.var()
    assert deviation.mean() == pytest.approx(0.0, abs=0.1)
    q = np.exp(-((np.pi * sigma) ** 2))
    kept = (1 + 2 * q) / (2 * np.sqrt(np.pi) * sigma)
    assert variance == pytest.approx(20.0**2 * kept**2, rel=0.02)
    assert kept**2 == pytest.approx(1 / (4 * np.pi * sigma**2), rel=0.035)
    assert converter.variance_share(sigma) == pytest.approx(kept, rel=1e-3)
    for apart in (1, 2, 3):
        along = (deviation[..., apart:] * deviation[..., :-apart]).mean() / variance
        down = (deviation[:, apart:] * deviation[:, :-apart]).mean() / variance
        expected = np.exp(-(apart**2) / (4 * sigma**2))
        expected *= (1 - 2 * q) / (1 + 2 * q) if apart % 2 else 1
        assert along == pytest.approx(expected, abs=0.01)
        assert down == pytest.approx(expected, abs=0.01)


def test_smoothing_averages_what_the_converter_can_hold():
    """A dot ten times above the ceiling is clipped before the averaging."""
    part = Imager(gain=1.0, full_well_e=1000.0, smoothing_px=1.0, bit_depth=8)
    hotter = dataclasses.replace(part, gain=10.0)
    light = np.zeros(SHAPE, np.float32)
    light[100, 100] = 1000.0
    assert read(hotter, light).max() == read(part, light).max()


@given(st.floats(0.3, 3.0), st.sampled_from([255, 1023, 65535]))
def test_gamma_inverts(gamma: float, ceiling: int):
    """The inverse gamma restores the signal (1e-4 of full scale); 0 and the ceiling are fixed."""
    signal = np.linspace(-0.02, 1.0, 500, dtype=np.float32)[None] * ceiling
    bent = converter.apply_gamma(signal, gamma, ceiling)
    assert converter.apply_gamma(bent, 1 / gamma, ceiling) == pytest.approx(
        signal, abs=1e-4 * ceiling
    )
    ends = converter.apply_gamma(np.array([[0.0, ceiling]], np.float32), gamma, ceiling)
    assert ends == pytest.approx(np.array([[0.0, ceiling]]), rel=1e-5)


def test_gamma_of_an_image_by_hand():
    """A quarter of full scale at gamma 2 is half of it; a dark pixel reads the black level."""
    part = Imager(gamma=2.0, bit_depth=8, full_well_e=1000.0, black_level_dn=10.0)
    assert (read(part, 250.0) == round(255 * 0.5 + 10)).all()
    assert (read(part, 0.0) == 10).all()
    assert part.saturation_dn == 255
    quiet = dataclasses.replace(part, gain=0.25)
    assert (read(quiet, 1e6) == quiet.saturation_dn).all()
    assert quiet.saturation_dn == round(255 * 0.5 + 10)


@pytest.mark.parametrize("bit_depth", [8, 10, 12, 16])
def test_quantisation_steps(bit_depth: int):
    """A ramp has all codes, each full_well / ceiling electrons wide; error std = step / sqrt 12.

    Does not cover a converter's differential non-linearity; all codes have one width.
    """
    part = Imager(bit_depth=bit_depth, full_well_e=4000.0)
    ramp = np.linspace(0, 4000, 2**19, dtype=np.float64).reshape(512, 1024)
    codes = read(part, ramp.astype(np.float32))
    assert len(np.unique(codes)) == 2**bit_depth
    assert (np.diff(codes.ravel()) >= 0).all()
    error = codes / part.dn_per_electron - ramp
    step = 4000.0 / (2**bit_depth - 1)
    # At 16 bits single precision is 0.03 of a step.
    assert np.abs(error).max() < 0.55 * step
    assert error.std() == pytest.approx(step / np.sqrt(12), rel=0.01)


@given(st.floats(0.2, 5.0), st.floats(0.5, 4.0))
def test_under_auto_exposure_light_and_gain_are_confusable(light: float, gain: float):
    """Auto exposure keeps the mean level for more light or gain.

    Does not cover the control's dynamics; it converges at once.
    """
    part = dataclasses.replace(FINE, auto_exposure_level=0.3, auto_exposure_max_s=10.0)
    base = np.random.default_rng(1).uniform(0.5, 1.5, (32, 32)).astype(np.float32) * 0.01
    stronger = dataclasses.replace(part, gain=gain)
    plain = imager.choose_exposure(part, base, 850.0)
    moved = imager.choose_exposure(stronger, base * np.float32(light), 850.0)
    assert moved.exposure_s == pytest.approx(plain.exposure_s / (light * gain), rel=1e-4)
    electrons = imager.mean_electrons(stronger, base * np.float32(light), 850.0, moved)
    level = float(electrons.mean()) * stronger.dn_per_electron + part.black_level_dn
    assert level == pytest.approx(0.3 * part.ceiling_dn, rel=1e-4)


@given(st.floats(1.0, 6.0), st.floats(200.0, 9000.0))
def test_a_smaller_full_well_is_a_larger_gain(factor: float, light: float):
    """At a gain of 1 or more, full well and gain are equivalent: equal codes, noise included.

    So "saturation" and "gain" belong to one family. Below a gain of 1 only the well saturates.
    """
    part = Imager(shot_noise=1.0, read_noise_e=5.0, full_well_e=12000.0, bit_depth=10)
    smaller = dataclasses.replace(part, full_well_e=12000.0 / factor)
    louder = dataclasses.replace(part, gain=factor)
    by_well, by_gain = read(smaller, light), read(louder, light)
    assert np.abs(by_well - by_gain).max() <= 1  # Rounding error of the factor.
    assert (by_well != by_gain).mean() < 0.01


def test_patterns_are_drawn_once():
    """Fixed patterns are cached, shared and read-only."""
    die = Die(7, "left")
    first = die.normal("prnu", (32, 48))
    assert first is die.normal("prnu", (32, 48))
    assert not first.flags.writeable
