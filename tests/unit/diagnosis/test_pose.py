"""A reference that stands off its place is put right by disparity.

**Rationale.** A room of walls at several slants and a block is moved by hand-made rotations and
shifts of its points, with other formulas than the fit's.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from diagnosis import pose
from sim import sensors
from sim.capture_info import CaptureInfo
from sim.capture_writer import info_of
from sim.scene import ModelError
from sim.sensor_edits import with_values

SENSOR = with_values(
    sensors.load("d415"),
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
