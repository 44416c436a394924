"""The light model of captured images: masks, exposure, black level, falloff."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration.least_squares import tiles
from starling.calibration.photometry import levels, light_model, photometry_fit
from starling.sim.geometry import frames
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.sensor import edits
from tests.unit.calibration.lit_table import AMBIENT_W_M2, SCENE, START, fitted_layers, observed


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_turned_projector_s_falloff_is_about_its_own_axis(side: levels.Side) -> None:
    """The falloff uses the angle between the projector's axis and each surface point."""
    sensor = edits.with_values(
        START, [("projector.rotation_deg", [6.0, -20.0, 9.0]), ("baseline_error", 0.02)]
    )
    depth_m = np.full((sensor.height, sensor.width), 0.6, np.float32)
    depth_m[:, 100:] = 1.5
    depth_m[0, 0] = np.nan
    log_cos = levels._projector_log_cos(depth_m, sensor, side)
    axis = frames.rotation((6.0, -20.0, 9.0))[:, 2]
    shift_m = 0.0 if side == "left" else sensor.baseline_m * 1.02
    for row, column in ((5, 7), (5, 300), (180, 30), (100, 200)):
        z = float(depth_m[row, column])
        x = (column - sensor.cx_px) / sensor.fx_px * z + shift_m
        y = (row - sensor.cy_px) / sensor.fy_px * z
        away = np.array([x, y, z]) - sensor.projector.position_m
        cosine = away @ axis / np.linalg.norm(away)
        assert log_cos[row, column] == pytest.approx(np.log(cosine), abs=1e-5)
    assert np.isfinite(log_cos).all()


@pytest.mark.parametrize("recorded", [None, Exposure(exposure_s=0.01, gain=3.0)])
def test_the_right_imager_s_gain_is_over_the_left_s(recorded: Exposure | None) -> None:
    """A recorded exposure is that of the left imager."""
    sensor = edits.with_values(START, [("left.gain", 1.5), ("right.gain", 2.1)])
    observation = dataclasses.replace(observed(), exposure=recorded)
    left, right = light_model.images([observation], sensor, fitted_layers())
    assert (left.side, right.side) == ("left", "right")
    assert left.exposure.gain == (1.5 if recorded is None else 3.0)
    assert right.exposure.gain == pytest.approx(left.exposure.gain * 1.4)


def test_a_tile_with_a_saturated_pixel_is_unused() -> None:
    """Excluding only the saturated pixel would bias the noise."""
    plain = observed()
    assert plain.left is not None
    before = light_model.images([plain], START, fitted_layers())[0].used
    row, column = np.argwhere(before)[len(np.argwhere(before)) // 2]
    level = plain.left.copy()
    level[row, column] = START.left.saturation_dn
    burnt = dataclasses.replace(plain, left=level)
    after = light_model.images([burnt], START, fitted_layers())[0].used
    tile = np.s_[row // 16 * 16 : row // 16 * 16 + 16, column // 16 * 16 : column // 16 * 16 + 16]
    assert before[tile].any() and not after[tile].any()
    apart = before.copy()
    apart[tile] = False
    np.testing.assert_array_equal(after, apart)


def test_dots_match_if_most_images_show_them() -> None:
    """If two of three images are noise, dots do not match."""
    image = light_model.images([observed()], START, fitted_layers())[0]
    noise = np.random.default_rng(0).normal(60, 5, image.level.shape).astype(np.float32)
    noise_image = dataclasses.replace(image, level=noise)
    assert light_model.dots_match([image, image, noise_image])
    assert not light_model.dots_match([image, noise_image, noise_image])
    assert not light_model.dots_match([dataclasses.replace(image, on=False)])


def test_variance_of_read_noise_rounding_shot_noise_and_speckle() -> None:
    """Shot noise [DN^2] is proportional to the signal, speckle to the square of laser light."""
    sensor = edits.with_values(
        START,
        [
            ("imager.read_noise_e", 7.0),
            ("imager.gain", 2.0),
            ("projector.speckle_contrast", 0.2),
            *((f"imager.{name}", 0.0) for name in ("dsnu_e", "row_noise_e", "column_noise_e")),
            ("imager.smoothing_px", 0.0),
        ],
    )
    image = light_model.images([observed()], sensor, fitted_layers())[0]
    values = light_model.start(sensor, {SCENE.name: AMBIENT_W_M2})
    least, per_signal, per_laser = light_model.columns(image, values, sensor, (), {}).variance
    step = 2.0 * sensor.left.ceiling_dn / sensor.left.full_well_e
    dark_e = sensor.left.dark_current_e_s * sensor.left.exposure_s
    assert least == pytest.approx((7.0**2 + dark_e) * step**2 + 1 / 12, rel=1e-4)
    assert per_signal == pytest.approx(step, rel=1e-3)
    assert per_laser == pytest.approx(0.2**2)


def test_the_black_level_s_column_is_not_scaled_by_the_reflectance() -> None:
    """Reflectance scales the power's column but not the black level's."""
    rng = np.random.default_rng(1)
    model, change = (rng.uniform(1, 2, (16, 32)) for _ in range(2))
    ones = np.ones((16, 32))
    signal = 0.4 * model + 0.01 * rng.standard_normal((16, 32))
    gram = tiles.grams([signal, model, ones, change], ones, means=False)
    case: Any = SimpleNamespace(names=(light_model.LEFT_BLACK, light_model.POWER))
    products = photometry_fit._jacobian(gram, case, "left")
    inner, factor = tiles.eliminate(gram, 1)
    assert factor == pytest.approx(0.4, rel=0.01)
    np.testing.assert_allclose(products[:, 0, :2], inner[:, 0, :2])
    np.testing.assert_allclose(products[:, 1, 1], inner[:, 1, 1])
    np.testing.assert_allclose(products[:, 1, 2], factor * inner[:, 1, 2])
    np.testing.assert_allclose(products[:, 2, 2], factor**2 * inner[:, 2, 2])


def test_initial_black_levels_are_limited_by_the_darkest_pixels() -> None:
    """The fitted sensor has no negative black level."""
    bright = edits.with_values(START, [("imager.black_level_dn", 30.0)])
    images = light_model.images([observed()], bright, fitted_layers())
    case = photometry_fit._case(images, bright, (), means=False)
    for image in images:
        start = case.values[light_model.black_name(image.side)]
        assert start == image.lowest_dn < 30.0
    low = {**case.values, light_model.LEFT_BLACK: -0.2}
    fitted = photometry_fit._fitted(bright, low)
    assert fitted.left.black_level_dn == 0.0
    assert fitted.right.black_level_dn == pytest.approx(case.values[light_model.RIGHT_BLACK])
