"""When and where a moving sensor looks, and what motion it refuses."""

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
    found, _ = motion.paths(mitsuba_scene.Stage(scene), small(), left, exposure_s)
    assert found is not None
    return found, left


@pytest.mark.parametrize("subpixels", [1, 2, 3])
@given(speed=st.floats(0.0, 60.0))
def test_moments_are_even_and_no_position_leads(subpixels, speed):
    """Times are spread evenly about 0; each position's times have mean 0."""
    step = dataclasses.replace(path(Motion(velocity_m_s=(0.1, 0, 0)))[0], steps=int(speed))
    found = np.array(motion.moments(subpixels, step))
    times = np.sort(found[:, 2])
    assert len(times) >= max(step.steps, 2 * subpixels**2)
    np.testing.assert_allclose(np.diff(times), 0.01 / len(times), rtol=1e-6)
    assert times[0] == pytest.approx(-0.005 + 0.005 / len(times))
    for place in {tuple(row) for row in found[:, :2]}:
        own = found[(found[:, :2] == place).all(axis=1), 2]
        assert own.sum() == pytest.approx(0, abs=1e-12)
        assert len(own) == len(found) / subpixels**2


def test_a_still_sensor_looks_at_the_fixed_positions_once():
    still = [(x, y, 0.0) for y in (-0.25, 0.25) for x in (-0.25, 0.25)]
    assert motion.moments(2, None) == still
    left, _ = cameras(small(), np.eye(4))
    found = motion.paths(mitsuba_scene.Stage(scenes.wall(1.0)), small(), left, 0.03)
    assert found == (None, None)


@given(
    velocity=st.tuples(*[st.floats(-5, 5)] * 3),
    turn=st.tuples(*[st.floats(-300, 300)] * 3),
    time=st.floats(-0.05, 0.05),
)
def test_places_on_the_way_are_rigid_motions(velocity, turn, time):
    """A part's place at a time is world_from_left pose(v t, w t), to single precision."""
    moving = Motion(velocity_m_s=velocity, turn_deg_s=turn)
    if moving.still:
        return
    found, left = path(moving, exposure_s=1e-6)
    times = np.full(left.size[0] * left.size[1], time, np.float32)
    place = found.at(backend.mitsuba().Float(times), left.place)
    vt, wt = (tuple(value * time for value in rate) for rate in (velocity, turn))
    expected = frames.pose(vt, wt)
    axes = [np.array(axis)[:, 0] for axis in (place.x, place.y, place.z)]
    np.testing.assert_allclose(np.stack(axes, axis=1), expected[:3, :3], atol=1e-6)
    np.testing.assert_allclose(np.array(place.origin)[:, 0], expected[:3, 3], atol=1e-6)


def test_longer_smears_take_more_moments():
    slow, _ = path(Motion(velocity_m_s=(0.9, 0, 0)))
    fast, _ = path(Motion(velocity_m_s=(19.9, 0, 0)))
    assert (slow.steps, fast.steps) == (1, 20)


def test_too_long_a_smear_is_refused():
    scene = dataclasses.replace(scenes.wall(1.0), motion=Motion(velocity_m_s=(50.0, 0, 0)))
    with pytest.raises(InputError, match=r"scene\.motion must blur the image by at most 100 px"):
        direct.layers(mitsuba_scene.Stage(scene), small(), exposure_s=0.05)


def test_motion_without_a_compiler_is_refused(monkeypatch):
    monkeypatch.setattr(backend, "is_jit", lambda: False)
    scene = dataclasses.replace(scenes.wall(1.0), motion=Motion(velocity_m_s=(1.0, 0, 0)))
    made = mitsuba_scene.Stage(scene)
    with pytest.raises(backend.BackendError, match=r"scene\.motion must be still in scalar_rgb"):
        direct.layers(made, small())


def test_nothing_in_view_does_not_smear():
    scene = dataclasses.replace(
        scenes.wall(1.0),
        motion=Motion(velocity_m_s=(1.0, 0, 0)),
        world_from_left=frames.pose((0, 0, 0), (0, 180, 0)),
    )
    assert not direct.layers(
        mitsuba_scene.Stage(scene), small(), exposure_s=0.01
    ).left.ambient.any()
