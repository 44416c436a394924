"""Size, sign and axis of features."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from starling.diagnosis.features import depth as depth_maps
from starling.diagnosis.features import infrared, shifts
from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.strata import FAR_OFF_PX
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND, HEIGHT, WIDTH


def angle(share: float) -> float:
    return float(np.arcsin(np.sqrt(share)))


def test_flicker_is_relative():
    power = np.array([0.9, 1.0, 1.1])
    frames = 100 * power[:, None, None] * np.ones((3, HEIGHT, WIDTH))
    features = infrared.infrared_repeat_features(frames, GROUND)
    assert features["time.flicker"] == pytest.approx(np.log(0.1), abs=1e-3)


def test_row_noise_is_measured_along_rows():
    rng = np.random.default_rng(0)
    frames = 100 + rng.standard_normal((4, HEIGHT, 1)) + np.zeros((1, 1, WIDTH))
    features = infrared.infrared_repeat_features(frames, GROUND)
    assert features["time.rows"] == pytest.approx(np.log(np.sqrt(3 / 4)), abs=0.1)
    assert features["time.columns"] < features["time.rows"] - 1


def test_temporal_noise_and_holes_have_the_right_size():
    """Law: two normal values of standard deviation s differ by 2 s / sqrt(pi) on average."""
    rng = np.random.default_rng(3)
    maps = DISPARITY + 0.1 * rng.standard_normal((12, HEIGHT, WIDTH))
    steady = depth_maps.depth_repeat_features(maps, GROUND)
    assert steady["time.disparity"] == pytest.approx(np.log(0.2 / np.sqrt(np.pi)), abs=0.01)
    assert steady["time.holes"] == 0
    removed = rng.random(DISPARITY.shape) < 0.2
    maps[-1][removed] = np.nan
    share = removed[GROUND.counted].mean()
    assert depth_maps.depth_repeat_features(maps, GROUND)["time.holes"] == pytest.approx(
        angle(share)
    )


def test_heavy_tails_are_measured():
    """Law: a Laplace variate's standard deviation is sqrt(2) / log 2 of its median deviation."""
    rng = np.random.default_rng(1)
    normal, laplace = (
        infrared.residual_features(EXPECTED + draw(0, 2, DISPARITY.shape), GROUND)[
            "noise.tails.expected.1/4"
        ]
        for draw in (rng.normal, rng.laplace)
    )
    assert normal == pytest.approx(0, abs=0.05)
    assert laplace == pytest.approx(np.log(np.sqrt(2) / (1.4826 * np.log(2))), abs=0.08)


@pytest.mark.parametrize("sign", [1, -1])
def test_bright_outliers_are_bright(sign: int):
    rng = np.random.default_rng(1)
    image = EXPECTED + rng.standard_normal(DISPARITY.shape)
    image[rng.random(image.shape) < 0.01] += sign * 60
    features = infrared.residual_features(image, GROUND)
    share = features["noise.bright outliers"] / features["noise.outliers"]
    assert features["noise.outliers"] > 0.08
    assert (share > 0.9) == (sign > 0) and (share < 0.5) == (sign < 0)


def test_correlation_along_rows_is_measured():
    noise = np.random.default_rng(1).standard_normal(DISPARITY.shape)
    lines = 3 * (noise + np.roll(noise, 1, axis=1))
    noise_features = infrared.residual_features(EXPECTED + lines, GROUND)
    fine = infrared.texture_features(100 + lines, GROUND)
    for features, name in (
        (noise_features, "noise.alike {}"),
        (fine, "texture.alike {}.dots.between"),
    ):
        assert features[name.format("1,0")] == pytest.approx(0.5, abs=0.06)
        assert features[name.format("0,1")] == pytest.approx(0.0, abs=0.06)


def test_blur_along_rows_reduces_slopes_along_rows():
    along, down = (cv2.GaussianBlur(EXPECTED, size, 2.0) for size in ((13, 1), (1, 13)))
    name = "texture.direction.radius.ring.dots.between"
    ratio_along, ratio_down = (
        infrared.texture_features(image, GROUND)[name] for image in (along, down)
    )
    assert ratio_along < -0.4 < 0.4 < ratio_down


def test_small_segments_holes_and_range_have_the_right_size():
    whole = depth_maps.surface_features(DISPARITY, GROUND)
    assert whole["range.far"] == pytest.approx(np.log(6))
    assert whole["range.near"] == pytest.approx(np.log(18))
    assert whole["surface.values"] == pytest.approx(np.log(2 / 12))
    assert whole["surface.columns"] == 0
    assert whole["surface.holes below 30"] == whole["surface.pieces below 30"] == 0
    odd = DISPARITY.copy()
    odd[10:16, 190:196] += 3  # A segment without its first row and column.
    odd[130:135, 190:195] = np.nan
    odd[:, :24] = np.nan
    features = depth_maps.surface_features(odd, GROUND)
    assert features["surface.columns"] == pytest.approx(angle(24 / 240))
    assert features["surface.pieces below 30"] == pytest.approx(angle(25 / DISPARITY.size))
    assert features["surface.holes below 30"] == pytest.approx(angle(25 / DISPARITY.size))


def test_wrong_matches_are_a_share_of_valid_pixels_and_fractions_are_relative_to_the_bias():
    measured = DISPARITY + np.float32(0.3)
    far = np.random.default_rng(0).random(DISPARITY.shape) < 0.1
    measured[far] += FAR_OFF_PX
    measured[:, : WIDTH // 2] = np.nan
    features = depth_maps.disparity_features(measured, GROUND)
    valid = GROUND.counted & np.isfinite(measured)
    assert features["error.far off.all"] == pytest.approx(angle(far[valid].mean()))
    assert features["error.bias.all"] == pytest.approx(0.3, abs=1e-5)
    assert features["error.fraction.fraction.0/8"] == pytest.approx(0, abs=1e-5)


def test_blur_flattens_correlation_peaks():
    sharp = shifts.dot_shift_features(EXPECTED, GROUND)
    soft = shifts.dot_shift_features(cv2.GaussianBlur(EXPECTED, (0, 0), 1.0), GROUND)
    assert soft["dots.width x.all"] < sharp["dots.width x.all"] - 0.1


def test_empty_codes_are_counted():
    rng = np.random.default_rng(0)
    everywhere = np.ones(DISPARITY.shape, bool)
    fourth = infrared.code_features(4.0 * rng.integers(5, 16, DISPARITY.shape), everywhere, 255.0)
    assert fourth["codes.empty"] == pytest.approx(0.75, abs=0.03)
    assert fourth["codes.comb"] == pytest.approx(2.0, abs=0.4)
    whole = infrared.code_features(1.0 * rng.integers(20, 60, DISPARITY.shape), everywhere, 255.0)
    assert whole["codes.empty"] == 0 and whole["codes.comb"] < 0.1


def test_saturated_pixels_are_those_at_the_ceiling():
    image = np.full(DISPARITY.shape, 50.0)
    image[:40] = 255.0
    share = (image == 255)[GROUND.counted].mean()
    assert infrared.level_features(image, GROUND, 255.0)["level.full"] == pytest.approx(
        angle(share)
    )


def test_an_observation_has_features_of_both_images_and_of_depth():
    left, right = (np.full((1, HEIGHT, WIDTH), level, np.uint8) for level in (40, 80))
    noise = np.random.default_rng(0).normal(0, 0.1, (1, HEIGHT, WIDTH))
    ours = (DISPARITY + noise).astype(np.float32)
    pair = StereoObservation(left=left, right=right, ours_px=ours)
    captured = pair.with_depth(ours + np.float32(0.2))
    features = infrared.image_features(captured, GROUND, ceiling=255.0)
    for name, level in (
        ("level.percentile 50", 40),
        ("right level.percentile 50", 80),
        ("right level.x.left.dots.between", 80),
    ):
        assert np.exp(features[name]) - 1 == pytest.approx(level, abs=0.6)
    depth = depth_maps.matched_depth_features(captured, GROUND, DISPARITY)
    assert depth["against.bias.all"] == pytest.approx(0.2, abs=1e-4)
