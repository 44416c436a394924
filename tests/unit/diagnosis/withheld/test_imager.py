"""The imager: photon transfer, fixed patterns and wells, each parameter the page's."""

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
    """Law: temporal variance = share^2 level + read^2; the mean stays."""
    held = _charge(camera, level_e, shot_noise=share, read_noise=12.0)
    variance = share**2 * level_e + 12.0**2
    assert held.var() == pytest.approx(variance, rel=0.04)
    assert held.mean() == pytest.approx(level_e, abs=4 * (variance / held.size) ** 0.5)


def test_dark_current_has_a_mean_and_its_noise(camera: Nominal) -> None:
    held = _charge(camera, 0.0, shot_noise=1.0, dark_current=30000.0, exposure=0.02)
    assert held.mean() == pytest.approx(600.0, rel=0.01)
    assert held.var() == pytest.approx(600.0, rel=0.04)


@pytest.mark.parametrize(("name", "value"), [("prnu", 0.05), ("dsnu", 30.0), ("column_noise", 25)])
def test_fixed_patterns_are_the_devices_own(name: str, value: float, camera: Nominal) -> None:
    """Still over frames, another in the right imager; PRNU grows with the level, offsets do not."""
    setting: dict[str, Any] = {name: value}
    first = _charge(camera, 1000.0, **setting)
    np.testing.assert_array_equal(first, _charge(camera, 1000.0, frame=5, **setting))
    other = _charge(camera, 1000.0, side="right", **setting)
    assert abs(np.corrcoef(first[0], other[0])[0, 1]) < 0.3
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


def test_fixed_patterns_are_not_normal(camera: Nominal) -> None:
    """Fourth moment over the squared variance: 3 of a normal, 4.2 of a logistic variate."""
    held = _charge(camera, 0.0, dsnu=10.0)
    assert np.mean(held**4) / held.var() ** 2 == pytest.approx(4.2, abs=0.4)


def test_hot_pixels_are_full(camera: Nominal) -> None:
    shares = []
    for seed in range(30):
        strengths = Strengths(nominal=camera, values={"hot_pixels": 0.005, "read_noise": 0})
        held = imager.charge(np.zeros(SHAPE), strengths, "left", Draws(seed=seed))
        assert set(np.unique(held)) <= {0.0, camera.full_well_e}
        shares.append((held > 0).mean())
    assert np.mean(shares) == pytest.approx(0.005, rel=0.1)


def test_crosstalk_has_the_pages_contrast_and_moment() -> None:
    """Law: contrast of the finest period times 1 - c, variance c / 2 along an axis."""
    stripes = np.tile([2.0, 0.0], (20, 20))
    seen = imager.share_charge(stripes, 0.3)[:, 2:-2]
    assert np.ptp(seen) == pytest.approx(2.0 * 0.7)
    point = np.zeros((9, 9))
    point[4, 4] = 1.0
    spot = imager.share_charge(point, 0.3)
    assert spot.sum() == pytest.approx(1.0)
    offset = np.arange(9) - 4
    for axis in (0, 1):
        assert (spot.sum(axis) * offset**2).sum() == pytest.approx(0.15)
    assert imager.share_charge(point, 0.0) is point


def test_crosstalk_leaves_noise_white(camera: Nominal) -> None:
    held = _charge(camera, 400.0, shot_noise=1.0, crosstalk=0.3)
    assert held.var() == pytest.approx(400.0, rel=0.04)
    assert abs(np.corrcoef(held[:, 1:].ravel(), held[:, :-1].ravel())[0, 1]) < 0.03


def test_blooming_fills_the_column_and_drains_the_rest() -> None:
    """Half of the share goes up and half down, into the room that it meets."""
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


def test_blooming_is_the_same_up_and_down() -> None:
    charge = np.random.default_rng(0).uniform(0, 160, (30, 20))
    up = imager.bloom(charge[::-1], 0.4, 100.0)[::-1]
    out = imager.bloom(charge, 0.4, 100.0)
    np.testing.assert_allclose(out, up)
    assert out.max() <= 100.0 + 1e-9
    assert (out >= np.minimum(charge, 100.0) - 1e-9).all()


def test_full_well_is_the_most(camera: Nominal) -> None:
    held = _charge(camera, 5000.0, shot_noise=1.0, saturation=4900.0)
    assert held.max() == 4900.0


@pytest.mark.parametrize(("name", "value"), [("prnu", 0.05), ("hot_pixels", 0.01)])
def test_pixels_are_by_birth(name: str, value: float, camera: Nominal) -> None:
    def held(side: str, scene: str, frame: int) -> np.ndarray:
        values = {"shot_noise": 0.0, "read_noise": 0.0, name: value}
        strengths = Strengths(nominal=camera, values=values)
        draws = Draws(seed=6, scene=scene, frame=frame)
        return imager.charge(np.full(SHAPE, 1000.0), strengths, side, draws)

    first = held("left", "a", 0)
    np.testing.assert_array_equal(first, held("left", "b", 5))
    assert not np.array_equal(first, held("right", "a", 0))


@pytest.mark.parametrize("noise", [{"shot_noise": 1.0}, {"read_noise": 12.0}, {"row_noise": 25.0}])
def test_noise_of_both_imagers_is_apart(noise: dict[str, float], camera: Nominal) -> None:
    left, right = (_charge(camera, 500.0, side=side, **noise) for side in ("left", "right"))
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.3
