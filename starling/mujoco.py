"""Depth cameras in MuJoCo models; needs the extra `mujoco`.

Examples:
    >>> import mujoco, starling.mujoco
    >>> model = mujoco.MjModel.from_xml_path("arm.xml")
    >>> data = mujoco.MjData(model)
    >>> camera = starling.mujoco.DepthCamera(model, "wrist", "d435")
    >>> mujoco.mj_step(model, data)
    >>> depth_m = camera.read(data).depth_m
"""

from __future__ import annotations

from starling.sim.mujoco.depth_camera import DepthCamera as DepthCamera
from starling.sim.mujoco.model_file import model_of as model_of
from starling.sim.mujoco.model_scene import scene as scene

__all__ = ["DepthCamera", "model_of", "scene"]
