"""Ambient light that surfaces nearby block: visibility of the sky, sampled and low-passed.

A point whose sky is visible from a share V, weighted by radiance and cosine, receives 1 - s (1 - V)
of the open sky's light. Only surfaces within `Ambient.reach_m` block; those farther away are the
room, which is as bright as the sky. s is `Ambient.occlusion`. Light that blockers reflect is
ignored, so a value below 1 approximates bright blockers.

Source: Zhukov, Iones and Kronin, An ambient light illumination model, 1998, eq. 2 (with a step
at the reach).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from starling.sim.arrays import Image
from starling.sim.render import backend, paths, upsampling
from starling.sim.render.lights import sky_excess, towards_viewer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitCamera, JitPose, pixels, reduced
from starling.sim.sensor.sensor import Sensor

_SHRINK = 2  # Reduction of the resolution of sampling.
_SAMPLES = 64  # Directions per coarse pixel.
_SIGMA_PX = 2.0  # Sigma of the low-pass [coarse px].


def ambient_factor(mi_scene: MitsubaScene, sensor: Sensor, place: JitPose) -> Image:
    """Ambient light over that of an open sky, at the pixels of an imager (h, w).

    Args:
        mi_scene: Scene in Mitsuba; its ambient light has `occlusion` and `reach_m`.
        sensor: Size and intrinsics.
        place: Pose of the imager.
    """
    coarse, fine = (reduced(sensor, place, shrink) for shrink in (_SHRINK, 1))
    low, high = (upsampling.guide(paths.surfaces(mi_scene, camera)) for camera in (coarse, fine))
    visible = upsampling.low_pass(sky_visibility(mi_scene, coarse), low, _SIGMA_PX)
    visible = np.minimum(upsampling.upsample(visible, low, high), 1)
    occlusion = np.float32(mi_scene.scene.ambient.occlusion)
    return np.asarray(1 - occlusion * (1 - visible), np.float32)


def sky_visibility(mi_scene: MitsubaScene, camera: JitCamera, *, samples: int = _SAMPLES) -> Image:
    """Share V of the sky's light that reaches the surfaces of an imager's pixels (h, w).

    It is 1 where there is no surface, and on mirrors and glass.

    Args:
        mi_scene: Scene in Mitsuba.
        camera: Imager.
        samples: Directions per pixel.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    ambient = mi_scene.scene.ambient
    si = mi_scene.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    matt = si.is_valid() & ((si.bsdf().flags() & int(mi.BSDFFlags.Delta)) == 0)
    frame = mi.Frame3f(towards_viewer(si))
    start = dr.arange(mi.UInt32, camera.size[0] * camera.size[1]) * samples
    lift = si.t * mi_scene.scene.shadow_tolerance
    reach = mi.Float(ambient.reach_m)
    dr.make_opaque(reach)

    def step(number: Any, seen: Any, total: Any) -> tuple[Any, Any, Any]:
        place = paths.spread(start + number)
        direction = frame.to_world(mi.warp.square_to_cosine_hemisphere(place))
        ray = si.spawn_ray(direction)
        ray.o += direction * lift
        ray.maxt = reach
        weight = 1 + sky_excess(ambient, direction, ambient.gradient)
        share = mi_scene.transmittance(ray, matt)
        return number + 1, seen + weight * share, total + weight

    def more(number: Any, *_: Any) -> Any:
        return number < samples

    zero = mi.UInt32(0), mi.Float(0), mi.Float(0)
    _, seen, total = dr.while_loop(zero, more, step, label="sky visibility")
    visible = dr.select(matt, seen / total, 1)
    return np.asarray(visible.numpy().reshape(camera.size[::-1]), np.float32)
