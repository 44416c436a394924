"""Direct light of scene and sensor, without Monte-Carlo noise.

Each pixel is sampled at n x n fixed sub-pixel positions (box filter). One ray from the imager finds
the surface. One ray *from the projector* tests its light, so that a noisy surface does not shadow
itself. Rays continue through mirrors and glass (`starling.sim.render.mirrors_and_glass`). Without
a compiler, `starling.sim.render.scalar` renders the same layers with Mitsuba's integrators.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry import motion, placement
from starling.sim.render import backend
from starling.sim.render.beam import ProjectorLight, shadow_ray
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.render.lights import Lights, towards_viewer
from starling.sim.render.mirrors_and_glass import Specular
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitCamera, cameras, pixels
from starling.sim.sensor.sensor import Sensor

_RAYS = 4_000_000  # Rays per launch; their positions and radiances take some 100 MB.


def layers(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    *,
    subpixels: int = 2,
    exposure_s: float = 0.0,
    step_px: float = motion.STEP_PX,
) -> Layers:
    """Render the direct light of both imagers, and the ground truth.

    Args:
        mi_scene: Scene in Mitsuba; its `world_from_left` poses the sensor.
        sensor: Geometry and projector; the layers are for 1 W.
        subpixels: n of the n x n fixed positions in a pixel.
        exposure_s: Exposure time of a moving sensor, over which views are averaged
            (see `starling.sim.geometry.motion`).
        step_px: Largest image motion between two of these views.

    Returns:
        Layers with zero indirect light (see `starling.sim.render.indirect`).
    """
    scene, (mi_scene, sensor) = mi_scene.scene, placement.rig_in_model(mi_scene, sensor)
    if not backend.is_jit():
        from starling.sim.render import scalar

        motion.refuse_without_compiler(scene.motion)
        return placement.scale_layers(scalar.layers(mi_scene, sensor, subpixels=subpixels), scene)
    left, right = cameras(sensor, mi_scene.scene.world_from_left)
    lights = Lights.from_sensor(mi_scene, sensor)
    paths = motion.exposure_motions(mi_scene, sensor, left, exposure_s, step_px=step_px)
    truth = _truth(mi_scene, left, right, lights.projector)
    centres = (truth.depth_m, truth.material)  # The truth belongs to the left imager.
    rendered = Layers(
        left=_view(mi_scene, sensor, left, lights, subpixels, paths[0], centres),
        right=None
        if sensor.kind == "structured_light"
        else _view(mi_scene, sensor, right, lights, subpixels, paths[1], _centres(mi_scene, right)),
        truth=truth,
    )
    return placement.scale_layers(rendered, scene)


def view(mi_scene: MitsubaScene, sensor: Sensor, *, subpixels: int = 2) -> ViewLayers:
    """Render the left imager alone, at rest (arguments as `layers`)."""
    if not backend.is_jit():
        from starling.sim.render import scalar

        return scalar.view(mi_scene, sensor, subpixels=subpixels)
    left, _ = cameras(sensor, mi_scene.scene.world_from_left)
    return _view(
        mi_scene,
        sensor,
        left,
        Lights.from_sensor(mi_scene, sensor),
        subpixels,
        None,
        _centres(mi_scene, left),
    )


def _view(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    camera: JitCamera,
    lights: Lights,
    subpixels: int,
    path: motion.ExposureMotion | None,
    centres: tuple[Image, NDArray[np.uint32]],
) -> ViewLayers:
    """Average n x n fixed positions per pixel, and several times for a moving sensor.

    One launch traces as many samples as memory allows, since a launch takes longer than the rays
    of a small image. Depth and body belong to the pixels' centres (see `_centres`); on glass they
    are those of the glass.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    shape, count = camera.size[::-1], camera.size[0] * camera.size[1]
    moments = motion.moments(subpixels, path)
    sums = np.zeros((lights.count, *shape), np.float32)
    most = max(1, _RAYS // count)
    for begin in range(0, len(moments), most):
        batch = moments[begin : begin + most]
        x, y, time_s = (dr.repeat(mi.Float(column), count) for column in zip(*batch, strict=True))
        posed, posed_lights = motion.at_time(path, time_s, camera, lights)
        ray = posed.ray(dr.tile(pixels(camera.size), len(batch)) + mi.Vector2f(x, y))
        if mi_scene.specular is None:
            radiances = posed_lights.reflected(mi_scene, mi_scene.mitsuba.ray_intersect(ray))
        else:
            radiances = _with_mirrors_and_glass(mi_scene, mi_scene.specular, posed_lights, ray)
        dr.eval(*radiances)
        for total, parts in zip(sums, radiances, strict=True):
            for part in parts.numpy().reshape(-1, *shape):
                total += part
    direct, ambient, *rest = sums * np.float32(1 / len(moments))
    if mi_scene.scene.ambient.occlusion:
        from starling.sim.render import occlusion

        ambient *= occlusion.ambient_factor(mi_scene, sensor, camera.place)
    depth, body = centres
    return ViewLayers(
        projector_direct=direct,
        projector_indirect=np.zeros(shape, np.float32),
        ambient=ambient,
        other=rest[0] if rest else np.zeros(shape, np.float32),
        depth_m=depth,
        body=body,
    )


def _with_mirrors_and_glass(
    mi_scene: MitsubaScene, specular: Specular, lights: Lights, ray: Any
) -> list[Any]:
    """Radiances along rays that mirrors reflect and glass refracts."""
    dr = backend.drjit()

    def reflected(si: Any, active: Any) -> list[Any]:
        si.t = dr.select(active, si.t, dr.inf)  # Inactive points count as misses.
        return lights.reflected(mi_scene, si)

    return specular.trace(
        mi_scene.mitsuba, ray, reflected, lambda direction: lights.sky(mi_scene, direction)
    )


def _centres(mi_scene: MitsubaScene, camera: JitCamera) -> tuple[Image, NDArray[np.uint32]]:
    """Depth [m] and body number at the pixel centres, each (h, w)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = mi_scene.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    columns = (camera.place.local(si.p).z, dr.reinterpret_array(mi.UInt32, si.shape), si.is_valid())
    dr.eval(*columns)
    depth, body, valid = (column.numpy().reshape(camera.size[::-1]) for column in columns)
    return (
        np.where(valid, depth, np.float32(np.nan)).astype(np.float32),
        mi_scene.body_numbers(body, valid),
    )


def _truth(
    mi_scene: MitsubaScene, left: JitCamera, right: JitCamera, light: ProjectorLight
) -> Truth:
    mi, dr = backend.mitsuba(), backend.drjit()
    si = mi_scene.mitsuba.ray_intersect(left.ray(pixels(left.size)))
    hit, normal = si.is_valid(), towards_viewer(si)
    faced = hit & right.sees(si.p)
    sight = shadow_ray(right.place.origin, si.p, mi_scene.scene.shadow_tolerance)
    place = left.place
    columns = (
        left.place.local(si.p).z,
        *(dr.dot(axis, normal) for axis in (place.x, place.y, place.z)),
        dr.reinterpret_array(mi.UInt32, si.shape),
        faced & ~mi_scene.mitsuba.ray_test(sight, faced),
        light.reaches(mi_scene, si.p, hit),
        hit,
    )
    dr.eval(*columns)
    shape = left.size[::-1]
    depth, nx, ny, nz, body, right_sees, lit, valid = (c.numpy().reshape(shape) for c in columns)
    missing = np.float32(np.nan)
    return Truth(
        depth_m=np.where(valid, depth, missing).astype(np.float32),
        normal=np.where(valid[..., None], np.stack([nx, ny, nz], axis=-1), missing),
        material=mi_scene.body_numbers(body, valid),
        right_sees=right_sees,
        lit=lit,
    )
