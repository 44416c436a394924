"""A small MuJoCo model in its reference state, and machines that cannot draw."""

from __future__ import annotations

import os
from typing import Any

import pytest

from starling.patterns import InputError
from starling.sim.mujoco.library import gl_context
from tests.unit.sim.mujoco.small_model import MODEL, assets

if not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # For the renderer of the package itself.
mujoco = pytest.importorskip("mujoco", reason="the package mujoco is not installed")


@pytest.fixture(scope="session")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(MODEL, assets())


@pytest.fixture
def data(model: Any) -> Any:
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    return state


@pytest.fixture(scope="session")
def drawing() -> None:
    """Skip a test where MuJoCo cannot draw."""
    try:
        gl_context(8, 8).free()
    except InputError as error:
        pytest.skip(str(error))
