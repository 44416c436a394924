"""Conversions to depth, and warnings of images that are probably no depth."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import starling
from starling.patterns.errors import InputError
from starling.sim.corrupt import Corruptor
from starling.sim.sensor import edits, presets
from starling.sim.warp import conversions, suspicions
from starling.sim.warp.depth_input import InputCamera

SHAPE = (120, 160)
MATRIX = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
CAMERA = InputCamera(MATRIX, SHAPE)
SENSOR = edits.with_camera(presets.load("d435"), MATRIX, (160, 120))
WALL = np.full(SHAPE, 1.2, np.float32)


def messages(depth_m: Any, camera: InputCamera = CAMERA) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        suspicions.warn_of_depth(np.asarray(depth_m, np.float32), camera)
    return [str(each.message) for each in caught]


def camera_messages(camera: InputCamera, sensor: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        suspicions.warn_of_cameras(camera, sensor)
    return [str(each.message) for each in caught]


@given(near=st.floats(0.01, 1), far=st.floats(2, 100), share=st.floats(0, 1))
def test_depth_buffers_are_inverted(near: float, far: float, share: float) -> None:
    """The forward map is that of glFrustum, followed by the viewport's."""
    z = near + share * (far - near) * 0.999
    buffer = 0.5 + 0.5 * ((far + near) / (far - near) - 2 * far * near / ((far - near) * z))
    back = conversions.depth_from_zbuffer(np.array([[np.clip(buffer, 0, 1)]]), near, far)
    assert back[0, 0] == pytest.approx(z, rel=1e-5)


@pytest.mark.parametrize(
    ("buffer", "planes", "message"),
    [
        (np.array([[1.1]]), (0.1, 10), r"zbuffer must be \(h, w\), in \[0, 1\]"),
        (np.array([0.5]), (0.1, 10), "zbuffer must be"),
        (np.array([[np.nan]]), (0.1, 10), "zbuffer must be"),
        (np.array([[0.5]]), (10, 0.1), "near_m, far_m must be 0 < near_m < far_m"),
        (np.array([[0.5]]), ("near", 10), "near_m, far_m must be an array of real numbers"),
    ],
)
def test_refused_depth_buffers(buffer: Any, planes: tuple[float, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        conversions.depth_from_zbuffer(buffer, *planes)


def test_a_far_plane_can_be_infinite() -> None:
    back = conversions.depth_from_zbuffer(np.array([[0.0, 0.5, 1.0]]), 0.1, np.inf)
    np.testing.assert_allclose(back, [[0.1, 0.2, np.nan]], rtol=1e-6)


def test_ranges_of_a_wall_are_bent() -> None:
    ranges = WALL * conversions.ray_length(SHAPE, MATRIX)
    np.testing.assert_allclose(conversions.depth_from_range(ranges, MATRIX), WALL, rtol=1e-6)
    assert any("distances along rays" in text for text in messages(ranges))
    assert messages(WALL) == []
    with pytest.raises(InputError, match="range_m must be"):
        conversions.depth_from_range(ranges[0], MATRIX)


def test_a_tilted_wall_is_no_range_image() -> None:
    x = (np.arange(160) - 79.5) / 150
    assert messages(np.repeat((1.5 / (1 + 0.4 * x))[None], 120, axis=0)) == []


def test_a_ball_is_no_range_image() -> None:
    """A curved surface is bent under both readings."""
    y, x = np.mgrid[:120, :160]
    ball = 1.5 - 0.4 * np.sqrt(np.maximum(1 - ((x - 80) ** 2 + (y - 60) ** 2) / 60**2, 0))
    assert messages(ball) == []


@pytest.mark.parametrize(
    ("farthest", "columns", "warns"), [(10.1, 2, True), (9.9, 80, False), (10.1, 1, False)]
)
def test_a_far_plane_is_reported(farthest: float, columns: int, warns: bool) -> None:
    depth = WALL.copy()
    depth[:, :columns] = farthest
    assert any("Set the far plane to NaN" in text for text in messages(depth)) == warns
    depth[:, :columns] = np.nan
    assert messages(depth) == []


@pytest.mark.parametrize(("low", "warns"), [(0.91, True), (0.89, False)])
def test_a_depth_buffer_is_reported(low: float, warns: bool) -> None:
    depth = np.random.default_rng(0).permutation(np.linspace(low, 1, 120 * 160)).reshape(SHAPE)
    depth[:9] = low + 1e-3  # 7 % of the pixels.
    assert any("depth_from_zbuffer" in text for text in messages(depth)) == warns


@pytest.mark.parametrize(
    ("share", "warns"), [(0.24, True), (0.26, False), (0.74, False), (0.76, True)]
)
@pytest.mark.parametrize("row", [0, 1])
def test_a_principal_point_beside_the_middle_half_is_reported(
    share: float, warns: bool, row: int
) -> None:
    matrix = MATRIX.copy()
    matrix[row, 2] = share * SHAPE[1 - row]
    texts = camera_messages(InputCamera(matrix, SHAPE), SENSOR)
    assert any("Is it for another image size" in text for text in texts) == warns


def tilted(nearest: float, slope: float) -> Any:
    """Depth of two tilted planes, one above the other."""
    x = (np.arange(160) - 79.5) / 150
    planes = nearest / (1 + slope * x / 2), 1.3 * nearest / (1 - slope * x)
    return np.concatenate([np.repeat(plane[None], 60, axis=0) for plane in planes])


@pytest.mark.parametrize("near", [0.01, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("far", [5.0, 100.0, 1000.0])
@pytest.mark.parametrize("is_reversed", [False, True])
def test_buffers_of_tilted_planes_are_reported(near: float, far: float, is_reversed: bool) -> None:
    """They are linear in inverse depth, whatever the near plane."""
    buffer = far / (far - near) * (1 - near / tilted(0.8, 0.8))
    texts = messages(1 - buffer if is_reversed else buffer)
    assert any("depth_from_zbuffer" in text for text in texts)


@pytest.mark.parametrize("nearest", [0.08, 0.2, 0.4])
@pytest.mark.parametrize("slope", [0.0, 0.1, 0.4, 0.8])
def test_near_planes_are_no_buffers(nearest: float, slope: float) -> None:
    depth = tilted(nearest, slope)
    assert messages(depth) == []
    assert messages(np.round(depth, 3)) == []


@pytest.mark.parametrize("depth_m", [0.95, 1.0])
def test_a_near_wall_is_no_buffer(depth_m: float) -> None:
    assert messages(np.full(SHAPE, depth_m)) == []


def test_single_pixels_are_no_buffer() -> None:
    sparse = np.full(SHAPE, np.nan)
    sparse[::6, ::6] = (0.9 * (1 - 0.1 / tilted(0.8, 0.8)))[::6, ::6]
    assert messages(sparse) == []


def test_a_near_ball_is_no_buffer() -> None:
    y, x = np.mgrid[:120, :160]
    ball = 0.5 - 0.2 * np.sqrt(np.maximum(1 - ((x - 80) ** 2 + (y - 60) ** 2) / 100**2, 0))
    assert messages(ball) == []


def test_a_matrix_of_another_size_is_reported() -> None:
    (text,) = camera_messages(InputCamera(MATRIX, (60, 80)), SENSOR)[:1]
    assert "principal point at (79.5, 59.5) of 80x60 px" in text
    assert camera_messages(CAMERA, SENSOR) == []


def test_a_narrow_image_and_a_wide_sensor_are_reported() -> None:
    texts = camera_messages(CAMERA, presets.load("d435"))
    assert any("of the sensor's image; the rest has no surface" in text for text in texts)
    matrix = np.array([[60.0, 0, 79.5], [0, 60.0, 59.5], [0, 0, 1]])
    wide = edits.with_camera(presets.load("d435"), matrix, (160, 120))
    (text,) = camera_messages(InputCamera(matrix, SHAPE), wide)
    assert "has no dots" in text


def test_warnings_come_once_for_each_size() -> None:
    corruptor = Corruptor(SENSOR, MATRIX)
    depth = WALL.copy()
    depth[:, :80] = 40
    with pytest.warns(UserWarning, match="Set the far plane to NaN"):
        corruptor(depth)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        corruptor(depth)


def test_warming_looks_at_no_image() -> None:
    corruptor = Corruptor("d435", MATRIX)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        corruptor.warm(SHAPE)
    with pytest.warns(UserWarning, match="the rest has no surface"):
        corruptor(WALL)
    with pytest.raises(InputError, match="height must be an integer"):
        corruptor.warm((0, 4))


def test_poses_of_the_further_depth_images() -> None:
    corruptor = Corruptor(SENSOR, MATRIX)
    assert corruptor.left_from_right[0, 3] == SENSOR.true_baseline_m
    assert tuple(corruptor.left_from_projector[:3, 3]) == SENSOR.projector.position_m


def test_a_sensor_of_another_camera_keeps_its_lens() -> None:
    d435 = presets.load("d435")
    focal_m = [each.fx_px * each.left.pixel_pitch_m for each in (d435, SENSOR)]
    assert focal_m[0] == pytest.approx(focal_m[1])
    assert (SENSOR.width, SENSOR.height, SENSOR.cx_px) == (160, 120, 79.5)
    loaded = starling.load_sensor("d435", camera_matrix=MATRIX, size=(160, 120))
    assert loaded == SENSOR
    for size in ((64,), (64, 48, 3), 64, None):
        with pytest.raises(InputError, match=r"size must be \(width, height\)"):
            edits.with_camera(d435, MATRIX, size)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="width must be an integer"):
        edits.with_camera(d435, MATRIX, (64.5, 48))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Is it transposed"):
        edits.with_camera(d435, MATRIX.T, (160, 120))
