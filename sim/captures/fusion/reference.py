"""Reference depth of a fused surface at given camera poses."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend, plugin_scene
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import cameras, pixels
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

_SEEN = "p:position,n:geo_normal"


def depths(mesh: trimesh.Trimesh, camera: Pinhole, poses: Sequence[Pose]) -> Iterator[Image]:
    """Trace z (h, w) [m] at each pose, NaN where no front side of the surface is visible.

    A back side is visible only through a hole in the front, so its depth is not used.

    Args:
        mesh: surface in the world frame [m].
        camera: intrinsics of the images.
        poses: `world_from_camera` of each image.

    Raises:
        InputError: if the mesh is not in metres, or the camera's pixels are not square (scalar
            variant only).
    """
    body = solids.body("fused", mesh, Material(name="fused"))
    stage = MitsubaScene(Scene(name="fused", bodies=(body,), world_from_left=poses[0]))
    lens = dataclasses.replace(presets.load("d435"), **dataclasses.asdict(camera))
    traced = _compiled if backend.is_jit() else _scalar
    for pose in poses:
        point, normal = traced(stage, lens, pose)
        away = point - pose[:3, 3]
        front = (normal * away).sum(axis=-1) < 0
        yield np.where(front, away @ pose[:3, 2], np.nan).astype(np.float32)


_Traced = tuple[NDArray[np.float64], NDArray[np.float64]]  # Points and normals, 0 without a hit.


def _compiled(stage: MitsubaScene, lens: Sensor, pose: Pose) -> _Traced:
    dr = backend.drjit()
    eye, _ = cameras(lens, pose)
    si = stage.mitsuba.ray_intersect(eye.ray(pixels(eye.size)))
    normal = dr.select(si.is_valid(), si.n, 0)
    dr.eval(si.p, normal)
    shape = (*eye.size[::-1], 3)
    point, normal = (np.array(vectors, np.float64).T.reshape(shape) for vectors in (si.p, normal))
    return point, normal


def _scalar(stage: MitsubaScene, lens: Sensor, pose: Pose) -> _Traced:
    mi = backend.mitsuba()
    eye = plugin_scene.camera(lens, pose, sampler=plugin_scene.fixed(1))
    integrator = mi.load_dict({"type": "aov", "aovs": _SEEN})
    image = np.array(mi.render(stage.mitsuba, sensor=eye, integrator=integrator, spp=1), np.float64)
    return image[..., :3], image[..., 3:6]
