"""The imager: photon transfer, fixed patterns, full well and codes follow the effect pages."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.validation.camera import imager
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.nominal import Nominal

SHAPE = (120, 160)


def _charge(
    camera: Nominal, level_e: float, frame: int = 0, side: str = "left", **values: Any
) -> np.ndarray:
    quiet = {"shot_noise": 0.0, "read_noise": 0.0, "saturation": 1e9, **values}
    draws = Draws(seed=6, scene="a", frame=frame)
    light = np.full(SHAPE, level_e)
    return imager.charge(light, Strengths(nominal=camera, values=quiet), side, draws)


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("level_e", [20.0, 500.0, 8000.0])
def test_photon_transfer(share: float, level_e: float, camera: Nominal) -> None:
    """Law: temporal variance = share^2 level + read^2; the mean is unchanged."""
    charge_e = _charge(camera, level_e, shot_noise=share, read_noise=12.0)
    variance = share**2 * level_e + 12.0**2
    assert charge_e.var() == pytest.approx(variance, rel=0.04)
    assert charge_e.mean() == pytest.approx(level_e, abs=4 * (variance / charge_e.size) ** 0.5)


def test_dark_current_adds_its_mean_and_shot_noise(camera: Nominal) -> None:
    charge_e = _charge(camera, 0.0, shot_noise=1.0, dark_current=30000.0, exposure=0.02)
    assert charge_e.mean() == pytest.approx(600.0, rel=0.01)
    assert charge_e.var() == pytest.approx(600.0, rel=0.04)


@pytest.mark.parametrize(("name", "value"), [("prnu", 0.05), ("dsnu", 30.0), ("column_noise", 25)])
def test_fixed_patterns_belong_to_the_imager(name: str, value: float, camera: Nominal) -> None:
    """Patterns are constant over frames and differ between imagers. Only PRNU scales with level."""
    setting: dict[str, Any] = {name: value}
    first = _charge(camera, 1000.0, **setting)
    np.testing.assert_array_equal(first, _charge(camera, 1000.0, frame=5, **setting))
    right = _charge(camera, 1000.0, side="right", **setting)
    assert abs(np.corrcoef(first[0], right[0])[0, 1]) < 0.3
    deviation = first.std() / (1000.0 if name == "prnu" else 1.0)
    assert deviation == pytest.approx(value, rel=0.15 if name == "column_noise" else 0.03)
    brighter = _charge(camera, 4000.0, **setting).std() / first.std()
    assert brighter == pytest.approx(4.0 if name == "prnu" else 1.0)


@pytest.mark.parametrize("length_px", [2.0, 8.0, 20.0])
def test_a_film_has_the_contrast_and_length_of_the_page(length_px: float, camera: Nominal) -> None:
    """Law: standard deviation over mean, and a correlation of 1/e at the length."""
    device = dataclasses.replace(camera, pattern_px=length_px)
    gains = []
    for seed in range(6):
        strengths = Strengths(nominal=device, values={"fixed_pattern": 0.1})
        gains.append(imager.film(strengths, "left", Draws(seed=seed, frame=seed), (300, 400)) - 1)
    field = np.stack(gains)
    assert field.std() == pytest.approx(0.1, rel=0.05) and abs(field.mean()) < 0.01
    apart = int(length_px)
    alike = (field[..., apart:] * field[..., :-apart]).mean() / field.var()
    assert alike == pytest.approx(np.exp(-1), abs=0.05)
    skewed = ((field - field.mean()) ** 3).mean() / field.std() ** 3
    assert 0.1 < skewed < 0.6  # Of a log-normal law 0.3, of a Gaussian 0.


def test_a_film_is_static_and_of_its_imager(camera: Nominal) -> None:
    first = _charge(camera, 1000.0, fixed_pattern=0.1)
    np.testing.assert_array_equal(first, _charge(camera, 1000.0, frame=5, fixed_pattern=0.1))
    np.testing.assert_allclose(4 * first, _charge(camera, 4000.0, fixed_pattern=0.1))
    right = _charge(camera, 1000.0, side="right", fixed_pattern=0.1)
    assert abs(np.corrcoef(first.ravel(), right.ravel())[0, 1]) < 0.3
    np.testing.assert_array_equal(_charge(camera, 1000.0), 1000.0)


@pytest.mark.parametrize("noise", [{"shot_noise": 1.0}, {"read_noise": 40.0}])
@pytest.mark.parametrize("correlation", [0.2, 0.5, 0.8])
def test_coloured_noise_keeps_its_variance(
    correlation: float, noise: dict[str, Any], camera: Nominal
) -> None:
    """Law: the variance of the photon transfer, and the correlation of adjacent pixels."""
    frames = np.stack(
        [
            _charge(camera, 1600.0, frame=frame, noise_colour=correlation, **noise)
            for frame in range(4)
        ]
    )
    assert frames.var() == pytest.approx(1600.0, rel=0.06)
    off = frames - frames.mean()
    across = (off[..., 1:] * off[..., :-1]).mean() / off.var()
    down = (off[:, 1:] * off[:, :-1]).mean() / off.var()
    assert (across, down) == pytest.approx((correlation, correlation), abs=0.04)


def test_columns_and_rows(camera: Nominal) -> None:
    columns = _charge(camera, 100.0, column_noise=25.0)
    assert columns.std(0).max() == pytest.approx(0.0, abs=1e-9)
    rows = [_charge(camera, 100.0, frame=frame, row_noise=25.0) for frame in range(10)]
    assert max(each.std(1).max() for each in rows) == pytest.approx(0.0, abs=1e-9)
    values = np.array([each[:, 0] for each in rows])
    assert values.std() == pytest.approx(25.0, rel=0.06)
    assert abs(np.corrcoef(values[0], values[1])[0, 1]) < 0.3


def test_fixed_patterns_are_not_gaussian(camera: Nominal) -> None:
    """Fourth moment over squared variance: 3 for a Gaussian, 4.2 for a logistic law."""
    charge_e = _charge(camera, 0.0, dsnu=10.0)
    assert np.mean(charge_e**4) / charge_e.var() ** 2 == pytest.approx(4.2, abs=0.4)


def test_hot_pixels_are_full(camera: Nominal) -> None:
    shares = []
    for seed in range(30):
        strengths = Strengths(nominal=camera, values={"hot_pixels": 0.005, "read_noise": 0})
        charge_e = imager.charge(np.zeros(SHAPE), strengths, "left", Draws(seed=seed))
        assert set(np.unique(charge_e)) <= {0.0, camera.full_well_e}
        shares.append((charge_e > 0).mean())
    assert np.mean(shares) == pytest.approx(0.005, rel=0.1)


def test_crosstalk_has_the_contrast_and_variance_of_the_page() -> None:
    """Law: the contrast of the finest period scales by 1 - c; the variance is c / 2 per axis."""
    stripes = np.tile([2.0, 0.0], (20, 20))
    blurred = imager.share_charge(stripes, 0.3)[:, 2:-2]
    assert np.ptp(blurred) == pytest.approx(2.0 * 0.7)
    point = np.zeros((9, 9))
    point[4, 4] = 1.0
    spot = imager.share_charge(point, 0.3)
    assert spot.sum() == pytest.approx(1.0)
    offset = np.arange(9) - 4
    for axis in (0, 1):
        assert (spot.sum(axis) * offset**2).sum() == pytest.approx(0.15)
    assert imager.share_charge(point, 0.0) is point


def test_crosstalk_keeps_noise_white(camera: Nominal) -> None:
    charge_e = _charge(camera, 400.0, shot_noise=1.0, crosstalk=0.3)
    assert charge_e.var() == pytest.approx(400.0, rel=0.04)
    assert abs(np.corrcoef(charge_e[:, 1:].ravel(), charge_e[:, :-1].ravel())[0, 1]) < 0.03


def test_blooming_fills_the_column_and_removes_the_rest() -> None:
    """Half of the share moves up and half down, into pixels below the full well."""
    charge = np.full((11, 3), 90.0)
    charge[5, 1] = 190.0
    out = imager.bloom(charge, 0.5, 100.0)
    expected = charge.copy()
    expected[3:8, 1] = [100, 100, 100, 100, 100]
    expected[[2, 8], 1] = 90.0 + 22.5 - 20.0
    np.testing.assert_allclose(out, expected)
    assert imager.bloom(charge, 0.0, 100.0) is charge
    full = np.full((4, 2), 300.0)
    np.testing.assert_allclose(imager.bloom(full, 0.5, 100.0), 100.0)


def test_blooming_is_symmetric() -> None:
    charge = np.random.default_rng(0).uniform(0, 160, (30, 20))
    up = imager.bloom(charge[::-1], 0.4, 100.0)[::-1]
    out = imager.bloom(charge, 0.4, 100.0)
    np.testing.assert_allclose(out, up)
    assert out.max() <= 100.0 + 1e-9
    assert (out >= np.minimum(charge, 100.0) - 1e-9).all()


def test_charge_is_limited_to_the_full_well(camera: Nominal) -> None:
    charge_e = _charge(camera, 5000.0, shot_noise=1.0, saturation=4900.0)
    assert charge_e.max() == 4900.0


@pytest.mark.parametrize(("name", "value"), [("prnu", 0.05), ("hot_pixels", 0.01)])
def test_pixel_patterns_do_not_change(name: str, value: float, camera: Nominal) -> None:
    def charge_e(side: str, scene: str, frame: int) -> np.ndarray:
        values = {"shot_noise": 0.0, "read_noise": 0.0, name: value}
        strengths = Strengths(nominal=camera, values=values)
        draws = Draws(seed=6, scene=scene, frame=frame)
        return imager.charge(np.full(SHAPE, 1000.0), strengths, side, draws)

    first = charge_e("left", "a", 0)
    np.testing.assert_array_equal(first, charge_e("left", "b", 5))
    assert not np.array_equal(first, charge_e("right", "a", 0))


@pytest.mark.parametrize("noise", [{"shot_noise": 1.0}, {"read_noise": 12.0}, {"row_noise": 25.0}])
def test_noise_of_both_imagers_is_independent(noise: dict[str, float], camera: Nominal) -> None:
    left, right = (_charge(camera, 500.0, side=side, **noise) for side in ("left", "right"))
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.3


def _codes(camera: Nominal, charge_e: np.ndarray | float, **values: float) -> np.ndarray:
    strengths = Strengths(nominal=camera, values=values)
    return imager.codes(np.full((20, 30), charge_e), strengths)


def test_gain_well_and_bits_scale_the_conversion(camera: Nominal) -> None:
    """Law: DN = gain * electrons * ceiling / full well + black level."""
    assert _codes(camera, 1000.0)[0, 0] == pytest.approx(25.5 + 4.0)
    assert _codes(camera, 1000.0, gain=3.0)[0, 0] == pytest.approx(76.5 + 4.0)
    assert _codes(camera, 1000.0, saturation=5000.0)[0, 0] == pytest.approx(51.0 + 4.0)
    assert _codes(camera, 1000.0, quantisation=10.0)[0, 0] == pytest.approx(102.3 + 4.0)
    assert _codes(camera, 1000.0, black_level=9.0)[0, 0] == pytest.approx(25.5 + 9.0)


def test_codes_stay_in_their_range(camera: Nominal) -> None:
    assert _codes(camera, 1e6).max() == 255.0
    assert _codes(camera, -1e6).min() == 0.0
    assert _codes(camera, 1e6, quantisation=10.0).max() == 1023.0


@pytest.mark.parametrize("gamma", [0.8, 1.3, 2.2])
def test_tone_curve_is_the_power_law(gamma: float) -> None:
    signal = np.linspace(0.0, 255.0, 300)
    law = 255.0 * (signal / 255.0) ** (1.0 / gamma)
    assert np.abs(imager.tone(signal, gamma, 255.0) - law).max() < 0.6
    assert imager.tone(np.array([-5.0]), gamma, 255.0)[0] == 0.0


def test_tone_curve_comes_before_the_black_level(camera: Nominal) -> None:
    assert _codes(camera, 0.0, gamma=2.2)[0, 0] == pytest.approx(4.0)
    assert _codes(camera, 2500.0, gamma=2.0)[0, 0] == pytest.approx(255 * 0.5 + 4.0, abs=0.3)


@pytest.mark.parametrize("sigma_px", [0.5, 1.0])
def test_smoothing_averages_noise(sigma_px: float) -> None:
    """Law: the noise variance scales by 1 / (4 pi sigma^2) in the limit of wide kernels.

    At 0.5 px the discrete kernel preserves 10 % more.
    """
    noise = np.random.default_rng(0).normal(100.0, 20.0, (200, 300))
    out = imager.smooth(noise, sigma_px)
    ratio = out.var() / noise.var()
    assert ratio == pytest.approx(1.0 / (4 * np.pi * sigma_px**2), rel=0.13)
    correlation = np.corrcoef(out[:, 1:].ravel(), out[:, :-1].ravel())[0, 1]
    assert correlation == pytest.approx(np.exp(-1 / (4 * sigma_px**2)), abs=0.08)
    assert imager.smooth(noise, 0.0) is noise


def test_codes_are_rounded_and_clipped() -> None:
    out = imager.round_codes(np.array([-3.0, 1.4, 1.6, 300.0]), 8)
    assert out.dtype == np.uint8
    assert out.tolist() == [0, 1, 2, 255]
    assert imager.round_codes(np.array([2000.0]), 10).tolist() == [1023]
    assert imager.round_codes(np.array([2000.0]), 10).dtype == np.uint16


def test_smoothing_averages_rounded_codes() -> None:
    np.testing.assert_allclose(imager.smooth(np.full((9, 9), 10.4), 0.5), 10.0)
