"""Pose of the reference depth, fitted to disparity.

**Rationale.** The planes of a room with a block are rotated and shifted in 3D, by formulas that
differ from those of the fit.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from starling.diagnosis.scenes import pose
from starling.sim.captures import png
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.writer import info_of
from starling.sim.scene.scene import ModelError
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.stereo.depth import to_code

SENSOR = with_values(
    presets.load("d415"),
    [("width", 480), ("height", 270), ("cx_px", 239.5), ("cy_px", 134.5), ("fx_px", 600.0)],
)
SENSOR = with_values(SENSOR, [("fy_px", 600.0)])
INFO: CaptureInfo = info_of(SENSOR, source="made here", licence="-", notes="")
TURN_DEG, SHIFT_M = (0.3, -0.2, 0.2), (0.003, -0.002, 0.006)
# Planes n . p = c: two walls, a floor, and the face of a block in front of them.
PLANES = (((0.3, 0.0, 1.0), 2.0), ((-0.4, 0.1, 1.0), 1.8), ((0.0, 1.0, 0.4), 0.9))
BLOCK = ((0.1, -0.1, 1.0), 0.9)


def room(pose_of: ModelError | None = None) -> np.ndarray:
    """Return the depth (h, w) of the planes, each moved by the pose."""
    y, x = np.indices((SENSOR.height, SENSOR.width))
    ray = np.stack(
        [(x - INFO.cx_px) / INFO.fx_px, (y - INFO.cy_px) / INFO.fy_px, np.ones(x.shape)], axis=-1
    )
    turn = Rotation.from_rotvec(np.deg2rad((0, 0, 0) if pose_of is None else pose_of.turn_deg))
    shift = np.zeros(3) if pose_of is None else np.asarray(pose_of.shift_m)

    def depth(plane: tuple[tuple[float, float, float], float]) -> np.ndarray:
        normal = turn.apply(plane[0])
        along = ray @ normal
        distance = np.asarray((plane[1] + normal @ shift) / np.where(along > 0, along, np.nan))
        return np.where(distance > 0, distance, np.inf)

    nearest = np.min([depth(plane) for plane in PLANES], axis=0)
    inside = (slice(60, 170), slice(180, 290))
    nearest[inside] = depth(BLOCK)[inside]
    return nearest.astype(np.float32)


def disparity_error(true: np.ndarray, believed: np.ndarray) -> np.ndarray:
    return INFO.disparity_px(true) - INFO.disparity_px(believed)


def test_a_motion_is_fitted_and_corrected():
    """With noise of 0.1 px and a tenth of wrong matches."""
    true = room(ModelError(turn_deg=TURN_DEG, shift_m=SHIFT_M))
    rng = np.random.default_rng(0)
    error_px = disparity_error(true, room()) + rng.normal(0, 0.1, true.shape)
    error_px[rng.random(error_px.shape) < 0.1] += 5.0
    fitted = pose.fit_pose(error_px, room(), INFO)
    assert fitted is not None
    # A turn about y and a shift along x are not separable; their sum is tested below.
    assert fitted.turn_deg[0] == pytest.approx(TURN_DEG[0], abs=0.08)
    moved = pose.move_depth(room(), INFO, fitted)
    before, after = (np.abs(disparity_error(true, depth)) for depth in (room(), moved))
    assert np.quantile(before, 0.9) > 0.2
    assert np.nanquantile(after, 0.9) < 0.05


@given(
    turn=st.tuples(*[st.floats(-0.3, 0.3)] * 3), shift=st.tuples(*[st.floats(-0.005, 0.005)] * 3)
)
@settings(max_examples=20)
def test_a_moved_reference_follows_its_points(turn, shift):
    motion = ModelError(turn_deg=turn, shift_m=shift)
    error = np.abs(disparity_error(room(motion), pose.move_depth(room(), INFO, motion)))
    assert np.nanquantile(error, 0.9) < 0.02
    assert np.isfinite(error).mean() > 0.95  # Unknown where it enters from outside the image.


def test_zero_error_gives_zero_motion():
    fitted = pose.fit_pose(np.zeros((SENSOR.height, SENSOR.width)), room(), INFO)
    assert fitted == ModelError()
    known = room()
    known[100:120] = np.nan
    assert_allclose(pose.move_depth(known, INFO, ModelError()), known, rtol=1e-6)


@pytest.mark.parametrize("known", [0.0, 0.05])
def test_too_few_known_cells_give_no_pose(known: float):
    error_px = np.full((SENSOR.height, SENSOR.width), np.nan)
    error_px[:, : int(known * SENSOR.width)] = 0.2
    assert pose.fit_pose(error_px, room(), INFO) is None


def wall(depth_m: float = 1.0) -> np.ndarray:
    return np.full((SENSOR.height, SENSOR.width), depth_m, np.float32)


def test_non_square_pixels_are_supported():
    """A tilted plane moves down by 1 cm: n . p = c becomes n . p = c + n . t."""
    info = dataclasses.replace(INFO, fy_px=450.0)
    ray_y = (np.arange(SENSOR.height)[:, None] - info.cy_px) / info.fy_px
    along = np.broadcast_to(0.5 * ray_y + 1, (SENSOR.height, SENSOR.width))
    before, after = ((c / along).astype(np.float32) for c in (1.5, 1.5 + 0.5 * 0.01))
    moved = pose.move_depth(before, info, ModelError(shift_m=(0.0, 0.01, 0.0)))
    inside = np.s_[10:-10, 10:-10]
    assert_allclose(moved[inside], after[inside], rtol=3e-4)


def test_a_fence_gives_no_pose():
    """Every pixel is next to a depth edge, where disparity is unreliable."""
    fence = np.where(np.indices((SENSOR.height, SENSOR.width))[1] % 8 < 4, 1.0, 2.0)
    assert pose.fit_pose(np.zeros(fence.shape), fence.astype(np.float32), INFO) is None


@pytest.mark.parametrize(("cells", "enough"), [(59, False), (60, True)])
def test_ten_cells_for_each_parameter_are_enough(cells: int, enough: bool):
    """Cells have 32 px; a row holds 15 of them."""
    error_px = np.full((SENSOR.height, SENSOR.width), np.nan)
    for number in range(cells):
        row, column = divmod(number, 15)
        error_px[32 * row : 32 * row + 32, 32 * column : 32 * column + 32] = 0.0
    assert (pose.fit_pose(error_px, wall(), INFO) is not None) == enough


def test_outlier_cells_have_little_weight():
    """A sixth of the wall is 3 px off, as if an object had been added."""
    error_px = np.full((SENSOR.height, SENSOR.width), -0.2)
    error_px[64:192, 320:448] -= 3.0
    fitted = pose.fit_pose(error_px, wall(), INFO)
    assert fitted is not None
    focal_baseline = INFO.disparity_px(np.array(1.0))
    # If a wall at 1 m moves away by z, its disparity decreases by f b z.
    assert fitted.shift_m[2] == pytest.approx(0.2 / focal_baseline, rel=0.05)


def test_noise_alone_moves_a_reference_within_the_prior():
    """A wall nearly parallel to the image hardly constrains shifts along it."""
    x = np.arange(SENSOR.width) - INFO.cx_px
    slanted = np.broadcast_to(1 + 5e-5 * x, (SENSOR.height, SENSOR.width)).astype(np.float32)
    noise = np.random.default_rng(1).normal(0, 4.0, slanted.shape)
    fitted = pose.fit_pose(noise, slanted, INFO)
    assert fitted is not None
    assert np.abs(fitted.turn_deg).max() < 0.2 and np.abs(fitted.shift_m).max() < 3e-3


def test_ten_cells_count_as_one():
    """A wall is farther by one prior deviation (0.1 px); cells alternate by +-0.22 px.

    The 120 cells count as 12. Their standard deviation is 0.33 px by the median, and a tenth less
    by Cauchy's weights. So their mean is as uncertain as the prior, and half of the shift is
    estimated.
    """
    far = float(INFO.disparity_px(np.array(1.0)) - INFO.disparity_px(np.array(1.003)))
    rows, columns = np.indices((SENSOR.height, SENSOR.width)) // 32
    fitted = pose.fit_pose(0.22 * (-1.0) ** (rows + columns) - far, wall(), INFO)
    assert fitted is not None
    assert fitted.shift_m[2] == pytest.approx(0.5 * 3e-3, rel=0.2)


def test_a_posed_scene_returns_its_moved_reference(tmp_path: Path):
    motion = ModelError(shift_m=(0.0, 0.0, 0.02))
    scene = pose.PosedScene(name="a", room="a", path=tmp_path, info=INFO, frames=(0,), pose=motion)
    assert scene.truth_m() is None
    (tmp_path / "truth.png").write_bytes(png.encode(to_code(wall(), INFO.depth_unit_m)))
    truth_m = scene.truth_m()
    assert truth_m is not None
    assert_allclose(truth_m[50:-50, 50:-50], 1.02, rtol=1e-5)
