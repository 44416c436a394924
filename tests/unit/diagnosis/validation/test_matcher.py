"""The second matcher: known disparities, no bias, and depth of capture sets."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera import matcher
from starling.diagnosis.validation.camera.chain import ExposedPair
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.rendered import UNIT_M, match_captures
from starling.diagnosis.validation.protocol.shoot import shoot
from starling.sim.captures import capture


def _textured(shape: tuple[int, int] = (48, 90), seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 200, shape).astype(np.uint8)


@pytest.mark.parametrize("shift", [3, 11])
def test_the_disparity_of_a_shifted_image_is_the_shift(shift: int) -> None:
    image = _textured()
    d = matcher.match(image, np.roll(image, -shift, 1))
    assert np.isfinite(d[:, 40:-4]).mean() > 0.98
    assert np.nanmedian(d) == pytest.approx(shift, abs=0.05)
    assert np.nanstd(d[:, 40:-4]) < 0.3


def test_no_depth_outside_the_overlap() -> None:
    image = _textured()
    d = matcher.match(image, np.roll(image, -20, 1))
    assert np.isnan(d[:, :14]).mean() > 0.9


def test_disparities_beyond_the_search_are_rejected() -> None:
    image = _textured((48, 300))
    near = matcher.match(image, np.roll(image, -120, 1))
    assert np.nanmedian(near) == pytest.approx(120.0, abs=0.05)
    beyond = matcher.match(image, np.roll(image, -150, 1))
    assert np.isfinite(beyond).mean() < 0.02


def test_unrelated_images_do_not_match() -> None:
    """Expected behaviour: the checks reject nearly all chance matches."""
    disparity_px = matcher.match(_textured(seed=1), _textured(seed=2))
    assert np.isfinite(disparity_px).mean() < 0.05


def test_depth_of_the_small_scene(take, light: SceneLight, camera: Nominal) -> None:
    """Results: more than 80 % of the visible pixels have depth, and the bias is below 0.1 px."""
    pair: ExposedPair = take(projector_power=0.45)
    z = matcher.depth(pair.left, pair.right, camera)
    assert z.dtype == np.float32
    truth = light.left.depth_m
    inner = np.s_[4:-4, 20:80]
    error = 6.0 / z[inner] - 6.0 / truth[inner]
    assert np.isfinite(error).mean() > 0.8
    assert abs(np.nanmedian(error)) < 0.1
    assert np.nanmedian(np.abs(error)) < 0.25


def test_an_offset_of_the_right_image_reduces_the_disparity(
    take, light: SceneLight, camera: Nominal
) -> None:
    """Law: d' = d - offset, with the sign of the conventions."""
    errors = []
    for offset in (0.0, 1.0):
        pair: ExposedPair = take(projector_power=0.45, disparity_offset=offset)
        z = matcher.depth(pair.left, pair.right, camera)
        errors.append(np.nanmedian(6.0 / z - 6.0 / light.left.depth_m))
    assert errors[1] - errors[0] == pytest.approx(-1.0, abs=0.15)


def test_a_full_size_pair_is_matched_in_seconds() -> None:
    """640 x 360 pixels with 128 disparities need less than 6 s of one core."""
    image = _textured((360, 640))
    start = time.process_time()
    matcher.match(image, np.roll(image, -30, 1))
    assert time.process_time() - start < 6.0


def test_invalid_pairs_are_refused() -> None:
    image = _textured()
    with pytest.raises(WithheldError, match="pair must share one shape"):
        matcher.match(image, image[:-1])
    with pytest.raises(WithheldError, match="images must be wider than 64 px"):
        matcher.match(image[:, :60], image[:, :60])


def test_the_last_disparity_is_rejected() -> None:
    image = _textured((48, 300))
    assert np.isfinite(matcher.match(image, np.roll(image, -127, 1))).mean() < 0.02


def test_path_costs_are_symmetric_in_rows_and_columns() -> None:
    costs = np.random.default_rng(0).integers(0, 25, (12, 20, 20)).astype(np.uint8)
    turned = matcher._aggregate(np.ascontiguousarray(costs.swapaxes(1, 2)))
    np.testing.assert_array_equal(matcher._aggregate(costs), turned.swapaxes(1, 2))


BOX_M = 0.5


@pytest.mark.parametrize("settings", [{}, {"quantisation": 16.0}])
def test_depth_agrees_with_the_scene(
    settings: dict[str, float], light_set: Path, light: SceneLight, camera: Nominal, tmp_path: Path
) -> None:
    """For 8 and 16 bits: no disparity bias, 0.1 px error on the box, and some missing depth."""
    case = Case(number=0, kind="single" if settings else "null", settings=settings, seed=4)
    shoot(light_set, case, tmp_path / "out", frames=2)
    match_captures(tmp_path / "out", camera)
    for scene in capture.open_set(tmp_path / "out").scenes:
        for number in range(2):
            depth_m = scene.frame(number).depth_m
            assert depth_m is not None
            valid = depth_m > 0
            assert 0.3 < valid.mean() < 1.0
            true_m = light.left.depth_m
            focal = camera.fx_px * camera.baseline_m
            error_px = focal / depth_m[valid] - focal / true_m[valid]
            box = true_m[valid] < BOX_M + 0.1
            assert abs(np.nanmedian(error_px)) < 0.02
            assert np.nanmedian(np.abs(error_px[box])) < 0.1
            units = depth_m[valid] / UNIT_M
            assert np.allclose(units, np.round(units), atol=1e-3)
