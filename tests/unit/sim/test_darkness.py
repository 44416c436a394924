"""Windows without light: their noise, the check of images, and what it spares."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from starling.sim.imaging import imager
from starling.sim.imaging.imager import DarkWindow, dark_window
from starling.sim.reason import Reason
from starling.sim.sensor import presets
from starling.sim.sensor.imager import Imager
from starling.sim.sensor.matcher import D4XX, FAST
from starling.sim.stereo import checks
from starling.sim.stereo.matching import match

LEVEL = 16  # Code of a dark pixel.
READ_NOISE = {"full_well_e": 255.0, "bit_depth": 8, "black_level_dn": 4.0}  # 1 DN an electron.


def imager_of(read_noise_e: float, **fields: float) -> Imager:
    """An imager of 10 matched bits with read noise alone."""
    settings = {**READ_NOISE, "dropped_bits": 2, "read_noise_e": read_noise_e}
    quiet = dataclasses.replace(presets.load("d435").left, dsnu_e=0.0, dark_current_e_s=0.0)
    return dataclasses.replace(quiet, **{**settings, **fields})


def chequered(amplitude: int, side: int = 60) -> np.ndarray:
    """Ten-bit image whose windows deviate by `amplitude` codes, up to 1e-5 of it."""
    y, x = np.mgrid[:side, :side]
    return (LEVEL + amplitude * (2 * ((y + x) % 2) - 1)).astype(np.uint16)


def test_every_pixel_of_a_window_without_light_is_rejected() -> None:
    """Only the lit column remains, although 15 columns have it in their windows."""
    seen = chequered(1)
    seen[:, 30] = 200
    rejected = checks.darkness(*checks.moments(seen), least_dn=0.3, ceiling_dn=100.0)
    assert np.flatnonzero(~rejected[0]).tolist() == [30]
    assert (rejected == rejected[0]).all()


@pytest.mark.parametrize(("excess", "dark"), [(-0.01, False), (0.01, True)])
def test_the_least_deviation_is_a_threshold(excess: float, dark: bool) -> None:
    seen = chequered(2)  # Two codes are half a DN.
    rejected = checks.darkness(*checks.moments(seen), least_dn=0.5 + excess, ceiling_dn=100.0)
    assert (rejected == dark).all()


@pytest.mark.parametrize(("excess", "dark"), [(-0.01, False), (0.01, True)])
def test_bright_windows_are_lit(excess: float, dark: bool) -> None:
    """Full pixels are as flat as dark ones."""
    seen = np.full((40, 40), 400, np.uint16)
    rejected = checks.darkness(*checks.moments(seen), least_dn=1.0, ceiling_dn=100.0 + excess)
    assert (rejected == dark).all()


def test_codes_of_eight_bits_are_whole_dn() -> None:
    eight, ten = (chequered(amplitude) for amplitude in (2, 8))
    for least_dn in (1.9, 2.1):
        first = checks.darkness(
            *checks.moments(eight.astype(np.uint8)), least_dn=least_dn, ceiling_dn=100.0
        )
        second = checks.darkness(*checks.moments(ten), least_dn=least_dn, ceiling_dn=100.0)
        assert (first == second).all()


@pytest.mark.parametrize("noise_dn", [0.08, 0.16, 0.6, 5.0])
@pytest.mark.parametrize("black_dn", [4.0, 4.125, 4.05])
def test_a_dark_window_deviates_as_codes_do(noise_dn: float, black_dn: float) -> None:
    """Against a sample: between two codes even little noise flickers."""
    window = dark_window(imager_of(noise_dn, black_level_dn=black_dn), 10)
    levels = np.random.default_rng(0).normal(black_dn * 4, noise_dn * 4, 400_000)
    assert window.deviation_dn == pytest.approx(np.rint(levels).std() / 4, rel=0.01)
    assert window.ceiling_dn == pytest.approx((black_dn + 255) / 2)


def test_noise_grows_with_gain_and_gamma() -> None:
    """Far above the step, the deviation is that of the noise and of the rounding."""
    louder = dark_window(imager_of(0.3, gain=4.0), 10)
    assert louder.deviation_dn == pytest.approx(math.hypot(1.2, 0.25 / math.sqrt(12)), rel=1e-6)
    curved = dark_window(imager_of(0.3, gamma=2.0), 10)
    noise_dn = 255 * math.sqrt(0.3 / 255)
    assert curved.deviation_dn == pytest.approx(math.hypot(noise_dn, 0.25 / math.sqrt(12)))


def test_codes_coarser_than_the_matchers_hide_the_noise() -> None:
    """From a quarter of a step on, codes of dark pixels differ."""
    assert dark_window(imager_of(0.249, dropped_bits=2), 8).deviation_dn == 0
    assert dark_window(imager_of(0.251, dropped_bits=2), 8).deviation_dn > 0.2
    assert dark_window(imager_of(0.249, dropped_bits=0), 8).deviation_dn > 0.2
    assert dark_window(imager_of(0.0, dropped_bits=0), 8).deviation_dn == 0


def test_dark_current_counts_at_the_longest_exposure() -> None:
    part = imager_of(0.3, dark_current_e_s=20.0, shot_noise=1.0, auto_exposure_max_s=0.1)
    fixed = dataclasses.replace(part, auto_exposure_level=0.0, exposure_s=0.05)
    for imager_at, electrons in ((part, 2.0), (fixed, 1.0)):
        variance = 0.3**2 + electrons + 0.25**2 / 12
        assert dark_window(imager_at, 10).deviation_dn == pytest.approx(math.sqrt(variance))


@pytest.mark.parametrize("name", ["d415", "d435", "d455"])
@pytest.mark.parametrize("black_dn", [4.0, 4.125])
@pytest.mark.parametrize("gain", [1.0, 8.0])
def test_every_pixel_of_a_dark_image_is_rejected(name: str, black_dn: float, gain: float) -> None:
    """At a code and between two codes, where noise flickers most."""
    part = presets.load(name).left
    part = dataclasses.replace(part, black_level_dn=black_dn, gain=gain)
    dark = np.zeros((160, 240), np.float32)
    settings = {"exposure_s": 0.033, "unit": 0, "side": "left", "seed": 0, "frame": 0}
    seen = imager.read_out(part, dark, **settings).matched
    window = dark_window(part, 10)
    least_dn = D4XX.checks.dark_noise * window.deviation_dn
    assert checks.darkness(
        *checks.moments(seen), least_dn=least_dn, ceiling_dn=window.ceiling_dn
    ).all()


def test_captures_of_eight_bits_are_spared() -> None:
    """A D415 stores 8 bits of the 10 that it matches."""
    assert dark_window(presets.load("d415").left, 8).deviation_dn == 0


@pytest.mark.parametrize("stock", [D4XX, FAST])
def test_matching_rejects_what_is_dark(stock) -> None:
    """A lit patch of disparity 10 px in noise of the imager."""
    rng = np.random.default_rng(0)
    left = rng.normal(LEVEL, 0.7, (120, 200))
    right = rng.normal(LEVEL, 0.7, (120, 200))
    dots = 400 * (rng.random((60, 60)) < 0.1)
    left[30:90, 100:160] += dots
    right[30:90, 90:150] += dots
    pair = [np.clip(np.rint(view), 0, 1023).astype(np.uint16) for view in (left, right)]
    dark = DarkWindow(0.2, 100.0)
    setting = dataclasses.replace(
        stock, search_px=32, checks=dataclasses.replace(stock.checks, dark_noise=1.2)
    )
    seen = match(*pair, setting, dark=dark)
    assert seen.valid[35:85, 105:155].mean() > 0.9
    assert not seen.valid[:20].any() and not seen.valid[:, :85].any()
    unaware = match(*pair, setting)
    assert np.array_equal(unaware.valid & ~seen.valid, unaware.valid != seen.valid)
    refused = unaware.valid & ~seen.valid
    assert set(np.unique(seen.reason[refused])) <= {Reason.SUPPORT, Reason.SPECKLE}
