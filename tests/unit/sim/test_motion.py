"""Times and poses of a moving sensor, and refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.geometry import frames, motion
from starling.sim.render import backend, direct, mitsuba_scene
from starling.sim.render.rays import cameras
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Motion
from starling.sim.sensor import presets


def small():
    return dataclasses.replace(
        presets.load("d435"), width=64, height=48, fx_px=50.0, fy_px=50.0, cx_px=31.5, cy_px=23.5
    )


def path(moving: Motion, exposure_s: float = 0.01):
    scene = dataclasses.replace(scenes.wall(1.0), motion=moving)
    left, _ = cameras(small(), scene.world_from_left)
    motions, _ = motion.exposure_motions(
        mitsuba_scene.MitsubaScene(scene), small(), left, exposure_s
    )
    assert motions is not None
    return motions, left


@pytest.mark.parametrize("subpixels", [1, 2, 3])
@given(speed=st.floats(0.0, 60.0))
def test_time_samples_are_even_for_all_positions(subpixels, speed):
    """Times are spread evenly about 0; each position's times have mean 0."""
    step = dataclasses.replace(path(Motion(velocity_m_s=(0.1, 0, 0)))[0], steps=int(speed))
    motions = np.array(motion.moments(subpixels, step))
    times = np.sort(motions[:, 2])
    assert len(times) >= max(step.steps, 2 * subpixels**2)
    np.testing.assert_allclose(np.diff(times), 0.01 / len(times), rtol=1e-6)
    assert times[0] == pytest.approx(-0.005 + 0.005 / len(times))
    for place in {tuple(row) for row in motions[:, :2]}:
        position_times = motions[(motions[:, :2] == place).all(axis=1), 2]
        assert position_times.sum() == pytest.approx(0, abs=1e-12)
        assert len(position_times) == len(motions) / subpixels**2


def test_a_still_sensor_looks_at_the_fixed_positions_once():
    still = [(x, y, 0.0) for y in (-0.25, 0.25) for x in (-0.25, 0.25)]
    assert motion.moments(2, None) == still
    left, _ = cameras(small(), np.eye(4))
    motions = motion.exposure_motions(
        mitsuba_scene.MitsubaScene(scenes.wall(1.0)), small(), left, 0.03
    )
    assert motions == (None, None)


@given(
    velocity=st.tuples(*[st.floats(-5, 5)] * 3),
    turn=st.tuples(*[st.floats(-300, 300)] * 3),
    time=st.floats(-0.05, 0.05),
)
def test_poses_during_motion_are_rigid(velocity, turn, time):
    """The pose of a part is world_from_left pose(v t, w t), to single precision."""
    moving = Motion(velocity_m_s=velocity, turn_deg_s=turn)
    if moving.still:
        return
    motions, left = path(moving, exposure_s=1e-6)
    times = np.full(left.size[0] * left.size[1], time, np.float32)
    place = motions.pose_at(backend.mitsuba().Float(times), left.place)
    vt, wt = (tuple(value * time for value in rate) for rate in (velocity, turn))
    expected = frames.pose(vt, wt)
    axes = [np.array(axis)[:, 0] for axis in (place.x, place.y, place.z)]
    np.testing.assert_allclose(np.stack(axes, axis=1), expected[:3, :3], atol=1e-6)
    np.testing.assert_allclose(np.array(place.origin)[:, 0], expected[:3, 3], atol=1e-6)


def test_longer_blur_needs_more_time_samples():
    slow, _ = path(Motion(velocity_m_s=(0.9, 0, 0)))
    fast, _ = path(Motion(velocity_m_s=(19.9, 0, 0)))
    assert (slow.steps, fast.steps) == (1, 20)


def test_too_long_blur_is_refused():
    scene = dataclasses.replace(scenes.wall(1.0), motion=Motion(velocity_m_s=(50.0, 0, 0)))
    with pytest.raises(InputError, match=r"scene\.motion must blur the image by at most 100 px"):
        direct.layers(mitsuba_scene.MitsubaScene(scene), small(), exposure_s=0.05)


def test_motion_without_a_compiler_is_refused(monkeypatch):
    monkeypatch.setattr(backend, "is_jit", lambda: False)
    scene = dataclasses.replace(scenes.wall(1.0), motion=Motion(velocity_m_s=(1.0, 0, 0)))
    mi_scene = mitsuba_scene.MitsubaScene(scene)
    with pytest.raises(backend.BackendError, match=r"scene\.motion must be still in scalar_rgb"):
        direct.layers(mi_scene, small())


def test_an_empty_view_has_no_blur():
    scene = dataclasses.replace(
        scenes.wall(1.0),
        motion=Motion(velocity_m_s=(1.0, 0, 0)),
        world_from_left=frames.pose((0, 0, 0), (0, 180, 0)),
    )
    assert not direct.layers(
        mitsuba_scene.MitsubaScene(scene), small(), exposure_s=0.01
    ).left.ambient.any()
