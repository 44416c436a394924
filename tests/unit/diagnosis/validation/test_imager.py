"""The imager: photon transfer, fixed patterns and full well follow the effect pages."""

from __future__ import annotations

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
