"""What `starling.sim.render.paths` gives made with Mitsuba's own path tracer, for want of a compiler."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, plugin_scene
from starling.sim.render.layers import Image
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.paths import Surfaces
from starling.sim.sensor.sensor import Sensor


def radiance(
    stage: Stage,
    sensor: Sensor,
    world_from_camera: Pose,
    irradiances: Sequence[Image],
    *,
    shrink: int,
    samples: int,
    seed: int,
) -> Image:
    """As `starling.sim.render.paths.radiance`, in any variant; what mirrors show counts as indirect here.

    Args:
        stage: the scene.
        sensor: with square pixels.
        world_from_camera: pose of one imager.
        irradiances: (h, w) of 1 W on the plane at unit distance over the projector's field, of
            each of its emitters.
        shrink: the image is smaller than the sensor's by this factor.
        samples: paths a pixel.
        seed: of the sampler.
    """
    mi = backend.mitsuba()
    sampler = {"type": "independent", "sample_count": samples}
    camera = plugin_scene.camera(sensor, world_from_camera, sampler=sampler, shrink=shrink)
    every, direct = (
        mi.load_dict({"type": "path", "max_depth": depth, "hide_emitters": True})
        for depth in (-1, 2)
    )
    total = np.float32(0)
    for number, irradiance in enumerate(irradiances):
        lit = plugin_scene.lit(stage, sensor, irradiance, number)
        # Equal seeds: the direct light is the same bits in both.
        one, other = (
            np.array(mi.render(lit, sensor=camera, integrator=each, spp=samples, seed=seed))
            for each in (every, direct)
        )
        total = total + np.maximum(one[..., 0] - other[..., 0], 0).astype(np.float32)
    return np.asarray(total, np.float32)


def surfaces(stage: Stage, sensor: Sensor, world_from_camera: Pose, *, shrink: int) -> Surfaces:
    """As `starling.sim.render.paths.surfaces`, in any variant."""
    mi = backend.mitsuba()
    camera = plugin_scene.camera(
        sensor, world_from_camera, sampler=plugin_scene.fixed(1), shrink=shrink
    )
    integrator = mi.load_dict({"type": "aov", "aovs": "p:position,n:sh_normal,a:albedo"})
    image = np.array(mi.render(stage.evenly_lit, sensor=camera, integrator=integrator, spp=1))
    hit = np.linalg.norm(image[..., 3:6], axis=-1) > 0.5
    local = (image[..., 0:3] - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    normal = image[..., 3:6] @ world_from_camera[:3, :3]
    away = np.einsum("ijk,ijk->ij", normal, local) > 0
    return Surfaces(
        albedo=np.minimum(image[..., 6], 1).astype(np.float32),
        depth_m=np.where(hit, local[..., 2], 0).astype(np.float32),
        normal=np.where(away[..., None], -normal, normal).astype(np.float32),
    )
