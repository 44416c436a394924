"""Depth cameras in MuJoCo with states that are wrong and models that change."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
import pytest

import starling.mujoco
from starling.patterns import InputError

BALL = """<mujoco><worldbody><geom name="ball" size=".1" pos="0 0 -1"/>
<camera name="top"/></worldbody></mujoco>"""


@pytest.fixture(params=["warp", "trace"])
def method(request: pytest.FixtureRequest) -> str:
    if request.param == "warp":
        request.getfixturevalue("drawing")
    return request.param


def _camera(model: Any, method: str) -> starling.mujoco.DepthCamera:
    return starling.mujoco.DepthCamera(model, "top", by=method, size=(160, 120))


def test_what_is_no_state_of_the_model_is_refused(model, data, method):
    camera, ball = _camera(model, method), mujoco.MjModel.from_xml_string(BALL)
    for state, message in (
        (None, "data must be of type MjData; got None. Give mujoco.MjData"),
        (mujoco.MjData(ball), "data must be of the camera's model; got 1 geoms and 1 cameras"),
    ):
        with pytest.raises(InputError, match=message):
            camera.read(state)
    data.geom_xpos[3] = np.nan
    with pytest.raises(InputError, match=r"data must be finite; .*The simulation diverged"):
        camera.read(data)


def test_readings_follow_sizes_and_colours_that_change(method):
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = _camera(model, method)
    before = camera.read(data)
    model.geom_rgba[0, :3] = 0.01
    model.geom_size[0, 0] = 0.2
    camera.reset()
    after, anew = camera.read(data), _camera(model, method).read(data)
    np.testing.assert_array_equal(after.ir_left, anew.ir_left)
    seen = [np.isfinite(reading.true_depth_m).sum() for reading in (before, after)]
    assert seen[1] > 3 * seen[0]


def test_a_field_that_changes_is_refused(method):
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = _camera(model, method)
    model.cam_fovy[0] /= 2
    with pytest.raises(InputError, match="field of the model's camera must stay; got another one"):
        camera.read(data)


def test_a_copy_of_the_model_has_states_too(method, model):
    data = mujoco.MjData(copy.copy(model))
    mujoco.mj_forward(model, data)
    assert np.isfinite(_camera(model, method).read(data).depth_m).any()
