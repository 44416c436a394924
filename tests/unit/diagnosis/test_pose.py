"""A reference that stands off its place is put right by disparity.

**Rationale.** A room of walls at several slants and a block is moved by hand-made rotations and
shifts of its points, with other formulas than the fit's.
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
# Planes n . p = c: two walls, a floor, and the face of a block that covers some of each.
PLANES = (((0.3, 0.0, 1.0), 2.0), ((-0.4, 0.1, 1.0), 1.8), ((0.0, 1.0, 0.4), 0.9))
BLOCK = ((0.1, -0.1, 1.0), 0.9)


def room(pose_of: ModelError | None = None) -> np.ndarray:
    """Depth (h, w) of the planes, each moved by itself."""
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


def off(true: np.ndarray, believed: np.ndarray) -> np.ndarray:
    return INFO.disparity_px(true) - INFO.disparity_px(believed)


def test_a_motion_is_found_and_put_right():
    """Noise of a tenth of a pixel and a tenth of wrong matches do not hide it."""
    true = room(ModelError(turn_deg=TURN_DEG, shift_m=SHIFT_M))
    rng = np.random.default_rng(0)
    seen = off(true, room()) + rng.normal(0, 0.1, true.shape)
    seen[rng.random(seen.shape) < 0.1] += 5.0
    found = pose.fitted(seen, room(), INFO)
    assert found is not None
    # Turns about y and shifts look alike, so those are told together alone.
    assert found.turn_deg[0] == pytest.approx(TURN_DEG[0], abs=0.08)
    before, after = (np.abs(off(true, one)) for one in (room(), pose.moved(room(), INFO, found)))
    assert np.quantile(before, 0.9) > 0.2
    assert np.nanquantile(after, 0.9) < 0.05


@given(
    turn=st.tuples(*[st.floats(-0.3, 0.3)] * 3), shift=st.tuples(*[st.floats(-0.005, 0.005)] * 3)
)
@settings(max_examples=20)
def test_a_reference_is_moved_as_its_points_are(turn, shift):
    moves = ModelError(turn_deg=turn, shift_m=shift)
    apart = np.abs(off(room(moves), pose.moved(room(), INFO, moves)))
    assert np.nanquantile(apart, 0.9) < 0.02
    assert np.isfinite(apart).mean() > 0.95  # But for what came in from outside the image.


def test_nothing_moves_where_nothing_is_off():
    found = pose.fitted(np.zeros((SENSOR.height, SENSOR.width)), room(), INFO)
    assert found == ModelError()
    known = room()
    known[100:120] = np.nan
    assert_allclose(pose.moved(known, INFO, ModelError()), known, rtol=1e-6)


@pytest.mark.parametrize("known", [0.0, 0.05])
def test_too_little_tells_nothing(known):
    seen = np.full((SENSOR.height, SENSOR.width), np.nan)
    seen[:, : int(known * SENSOR.width)] = 0.2
    assert pose.fitted(seen, room(), INFO) is None


def wall(depth_m: float = 1.0) -> np.ndarray:
    return np.full((SENSOR.height, SENSOR.width), depth_m, np.float32)


def test_pixels_that_are_not_square_are_reckoned_with():
    """A tilted plane that sinks by 1 cm: n . p = c becomes n . p = c + n . t."""
    info = dataclasses.replace(INFO, fy_px=450.0)
    ray_y = (np.arange(SENSOR.height)[:, None] - info.cy_px) / info.fy_px
    along = np.broadcast_to(0.5 * ray_y + 1, (SENSOR.height, SENSOR.width))
    before, after = ((c / along).astype(np.float32) for c in (1.5, 1.5 + 0.5 * 0.01))
    found = pose.moved(before, info, ModelError(shift_m=(0.0, 0.01, 0.0)))
    inside = np.s_[10:-10, 10:-10]
    assert_allclose(found[inside], after[inside], rtol=3e-4)


def test_a_fence_tells_nothing():
    """Where every pixel is beside an edge no disparity is the surface's own."""
    fence = np.where(np.indices((SENSOR.height, SENSOR.width))[1] % 8 < 4, 1.0, 2.0)
    assert pose.fitted(np.zeros(fence.shape), fence.astype(np.float32), INFO) is None


@pytest.mark.parametrize(("squares", "told"), [(59, False), (60, True)])
def test_ten_squares_for_each_number_are_enough(squares: int, told: bool):
    """Of 32 px, 15 in a row."""
    seen = np.full((SENSOR.height, SENSOR.width), np.nan)
    for number in range(squares):
        row, column = divmod(number, 15)
        seen[32 * row : 32 * row + 32, 32 * column : 32 * column + 32] = 0.0
    assert (pose.fitted(seen, wall(), INFO) is not None) == told


def test_squares_that_are_far_off_count_little():
    """A sixth of the wall is 3 px off, as where a thing was put there since."""
    seen = np.full((SENSOR.height, SENSOR.width), -0.2)
    seen[64:192, 320:448] -= 3.0
    found = pose.fitted(seen, wall(), INFO)
    assert found is not None
    focal_baseline = INFO.disparity_px(np.array(1.0))
    # Farther by z a wall at 1 m has f b z less disparity.
    assert found.shift_m[2] == pytest.approx(0.2 / focal_baseline, rel=0.05)


def test_noise_alone_moves_a_reference_no_farther_than_is_expected():
    """A wall all but parallel to the image tells next to nothing of shifts along it."""
    x = np.arange(SENSOR.width) - INFO.cx_px
    slanted = np.broadcast_to(1 + 5e-5 * x, (SENSOR.height, SENSOR.width)).astype(np.float32)
    noise = np.random.default_rng(1).normal(0, 4.0, slanted.shape)
    found = pose.fitted(noise, slanted, INFO)
    assert found is not None
    assert np.abs(found.turn_deg).max() < 0.2 and np.abs(found.shift_m).max() < 3e-3


def test_ten_squares_tell_as_much_as_one():
    """A wall is farther by what is expected, 0.1 px, in squares that are off by 0.22 px to and fro.

    120 squares were worth 12, of 0.33 px by the median and a tenth less by Cauchy's weights: 0.1 px
    to one deviation, as sure as what is expected. About half of the way is believed.
    """
    far = float(INFO.disparity_px(np.array(1.0)) - INFO.disparity_px(np.array(1.003)))
    rows, columns = np.indices((SENSOR.height, SENSOR.width)) // 32
    found = pose.fitted(0.22 * (-1.0) ** (rows + columns) - far, wall(), INFO)
    assert found is not None
    assert found.shift_m[2] == pytest.approx(0.5 * 3e-3, rel=0.2)


def test_a_posed_scene_gives_its_reference_as_it_stands(tmp_path: Path):
    moves = ModelError(shift_m=(0.0, 0.0, 0.02))
    scene = pose.Posed(name="a", room="a", path=tmp_path, info=INFO, frames=(0,), pose=moves)
    assert scene.truth_m() is None
    (tmp_path / "truth.png").write_bytes(png.encode(to_code(wall(), INFO.depth_unit_m)))
    found = scene.truth_m()
    assert found is not None
    assert_allclose(found[50:-50, 50:-50], 1.02, rtol=1e-5)
