"""MuJoCo's own depth and unlit colours, from any place and with any camera matrix."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry.frames import Pose
from starling.sim.mujoco.library import current, gl_context, mujoco
from starling.sim.sensor.sensor import Sensor

_FAR = 0.999  # Share of the far plane's distance beyond which there is no surface.
_MOST_GEOMS = 20_000


class Buffers:
    """Draws a model as seen by a camera of a sensor's size and intrinsics.

    Lights, shadows, fog and mirrors are off, so that colours are those of the surfaces.
    """

    def __init__(self, model: Any, sensor: Sensor, groups: tuple[int, ...]) -> None:
        """Open a context of OpenGL.

        Args:
            model: `mujoco.MjModel`.
            sensor: gives size and intrinsics of all images.
            groups: groups of geoms to draw.

        Raises:
            InputError: if MuJoCo cannot draw on this machine.
        """
        gl = mujoco()
        self._model, self._sensor = model, sensor
        self._context: Any = gl_context(sensor.width, sensor.height)
        quality = model.vis.quality
        samples, size = (
            quality.offsamples,
            (model.vis.global_.offwidth, model.vis.global_.offheight),
        )
        quality.offsamples = 0  # Several samples a pixel would mix surfaces.
        model.vis.global_.offwidth, model.vis.global_.offheight = sensor.width, sensor.height
        try:
            scale = gl.mjtFontScale.mjFONTSCALE_100
            with current(self._context):
                self._renderer: Any = gl.MjrContext(model, scale.value)
        finally:
            quality.offsamples = samples
            model.vis.global_.offwidth, model.vis.global_.offheight = size
        self._free = weakref.finalize(self, _free, self._context, self._renderer)
        self._free.atexit = False  # The end of the process frees all, in MuJoCo's order.
        # Reversed depth keeps its precision far away: 1 at the near plane, 0 at the far plane.
        self._renderer.readDepthMap = gl.mjtDepthMap.mjDEPTH_ZEROFAR.value
        with current(self._context):
            gl.mjr_setBuffer(gl.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._scene: Any = gl.MjvScene(model, _MOST_GEOMS)
        self._option: Any = _option(gl, groups)
        self._rect: Any = gl.MjrRect(0, 0, sensor.width, sensor.height)

    def update(self, data: Any, world_from_left: Pose) -> None:
        """Take the poses of the geoms. Planes without end are centred at the left imager."""
        gl = mujoco()
        self._aim(world_from_left)
        gl.mjv_updateScene(
            self._model,
            data,
            self._option,
            None,
            gl.MjvCamera(),
            gl.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        _unlit(gl, self._scene)

    def draw(
        self, world_from_camera: Pose, *, colours: bool = False
    ) -> tuple[Image, NDArray[np.uint8] | None]:
        """Depth (h, w) [m], NaN without a surface, and colours (h, w, 3) in sRGB.

        Args:
            world_from_camera: place of the camera, in OpenCV's axes.
            colours: whether to read colours too.
        """
        gl = mujoco()
        near, far = self._aim(world_from_camera)
        shape = (self._sensor.height, self._sensor.width)
        depth = np.empty(shape, np.float32)
        rgb = np.empty((*shape, 3), np.uint8) if colours else None
        with current(self._context):
            gl.mjr_render(self._rect, self._scene, self._renderer)
            gl.mjr_readPixels(rgb, depth, self._rect, self._renderer)
        z = near * far / (near + np.float64(depth[::-1]) * (far - near))
        depth_m = np.where(z < _FAR * far, z, np.nan).astype(np.float32)
        return depth_m, None if rgb is None else np.ascontiguousarray(rgb[::-1])

    def _aim(self, pose: Pose) -> tuple[float, float]:
        """Set the cameras of the scene, and return the distances of the clipping planes [m]."""
        sensor, extent = self._sensor, float(self._model.stat.extent)
        near = float(self._model.vis.map.znear) * extent
        far = float(self._model.vis.map.zfar) * extent
        # Edges of the image lie half a pixel beyond the centres of its outer pixels.
        left, right = -(sensor.cx_px + 0.5), sensor.width - 0.5 - sensor.cx_px
        top, bottom = sensor.cy_px + 0.5, -(sensor.height - 0.5 - sensor.cy_px)
        for camera in self._scene.camera:
            camera.pos = pose[:3, 3]
            camera.forward, camera.up = pose[:3, 2], -pose[:3, 1]
            camera.frustum_near, camera.frustum_far = near, far
            camera.frustum_center = (left + right) / 2 / sensor.fx_px * near
            camera.frustum_width = (right - left) / 2 / sensor.fx_px * near
            camera.frustum_top = top / sensor.fy_px * near
            camera.frustum_bottom = bottom / sensor.fy_px * near
            camera.orthographic = 0
        return near, far

    def close(self) -> None:
        """Free the context; a second call does nothing."""
        self._free()


def _free(context: Any, renderer: Any) -> None:
    with current(context):  # The renderer's names in OpenGL are those of its context.
        renderer.free()
    context.free()


def _option(gl: Any, groups: tuple[int, ...]) -> Any:
    option = gl.MjvOption()
    option.geomgroup[:] = [number in groups for number in range(len(option.geomgroup))]
    for name in ("site", "joint", "tendon", "actuator"):
        getattr(option, f"{name}group")[:] = 0
    return option


def _unlit(gl: Any, scene: Any) -> None:
    """Replace lights by one that is equal from all sides."""
    flags = gl.mjtRndFlag
    for flag in (flags.mjRND_SHADOW, flags.mjRND_REFLECTION, flags.mjRND_FOG, flags.mjRND_HAZE):
        scene.flags[flag] = 0
    scene.flags[flags.mjRND_SKYBOX] = 0
    scene.nlight = 1
    light = scene.lights[0]
    light.ambient, light.diffuse, light.specular = np.ones(3), np.zeros(3), np.zeros(3)
    light.headlight = 1
