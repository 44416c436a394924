"""Indirect light and surfaces by Mitsuba's path tracer, for the scalar variant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.sim.arrays import Image
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, plugin_scene
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.paths import Surfaces
from starling.sim.sensor.sensor import Sensor


def radiance(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    world_from_camera: Pose,
    irradiances: Sequence[Image],
    *,
    shrink: int,
    samples: int,
    seed: int,
) -> Image:
    """As `starling.sim.render.paths.radiance`, in any variant.

    Light by way of mirrors counts as indirect here.

    Args:
        mi_scene: Scene in Mitsuba.
        sensor: Sensor with square pixels.
        world_from_camera: Pose of one imager.
        irradiances: Irradiance (h, w) of each emitter at unit distance over the projector's field,
            for 1 W in total.
        shrink: Reduction of the image's size.
        samples: Paths per pixel.
        seed: Seed of the sampler.
    """
    mi = backend.mitsuba()
    sampler = {"type": "independent", "sample_count": samples}
    camera = plugin_scene.camera(sensor, world_from_camera, sampler=sampler, shrink=shrink)
    full, direct = (
        mi.load_dict({"type": "path", "max_depth": depth, "hide_emitters": True})
        for depth in (-1, 2)
    )
    total = np.float32(0)
    for number, irradiance in enumerate(irradiances):
        lit = plugin_scene.lit(mi_scene, sensor, irradiance, number)
        # With equal seeds the direct light has equal bits in both images.
        all_light, direct_light = (
            np.array(mi.render(lit, sensor=camera, integrator=integrator, spp=samples, seed=seed))
            for integrator in (full, direct)
        )
        total = total + np.maximum(all_light[..., 0] - direct_light[..., 0], 0).astype(np.float32)
    return np.asarray(total, np.float32)


def surfaces(
    mi_scene: MitsubaScene, sensor: Sensor, world_from_camera: Pose, *, shrink: int
) -> Surfaces:
    """As `starling.sim.render.paths.surfaces`, in any variant."""
    mi = backend.mitsuba()
    camera = plugin_scene.camera(
        sensor, world_from_camera, sampler=plugin_scene.fixed(1), shrink=shrink
    )
    integrator = mi.load_dict({"type": "aov", "aovs": "p:position,n:sh_normal,a:albedo"})
    image = np.array(mi.render(mi_scene.albedo_scene, sensor=camera, integrator=integrator, spp=1))
    hit = np.linalg.norm(image[..., 3:6], axis=-1) > 0.5
    local = (image[..., 0:3] - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    normal = image[..., 3:6] @ world_from_camera[:3, :3]
    away = np.einsum("ijk,ijk->ij", normal, local) > 0
    return Surfaces(
        albedo=np.minimum(image[..., 6], 1).astype(np.float32),
        depth_m=np.where(hit, local[..., 2], 0).astype(np.float32),
        normal=np.where(away[..., None], -normal, normal).astype(np.float32),
    )
