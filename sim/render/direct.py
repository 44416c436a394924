"""Scene and sensor to layers: one traced pass a view, no Monte-Carlo noise in direct light.

Every pixel is sampled at n x n fixed sub-pixel positions (box filter). At each the surface is
found by one ray from the imager and the projector's light by one ray *from the projector*, so
that a surface with noise does not shadow itself. Mirrors and glass are followed
(`starling.sim.render.mirrors_and_glass`) where a scene has them. Where no compiler is, `starling.sim.render.scalar` makes
the same layers with Mitsuba's own integrators.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import motion, placement
from starling.sim.render import backend
from starling.sim.render.beam import Light, between
from starling.sim.render.layers import Image, Layers, Truth, View
from starling.sim.render.lights import Lights, towards_viewer
from starling.sim.render.mirrors_and_glass import Specular
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Camera, cameras, pixels
from starling.sim.sensor.sensor import Sensor

_RAYS = 4_000_000  # Of one launch: their positions and radiances take some 100 MB.


def layers(
    stage: Stage,
    sensor: Sensor,
    *,
    subpixels: int = 2,
    exposure_s: float = 0.0,
    step_px: float = motion.STEP_PX,
) -> Layers:
    """Render what both imagers of a sensor receive, and the truth.

    Args:
        stage: the scene in Mitsuba; its `world_from_left` poses the sensor.
        sensor: geometry and projector; the layers are for 1 W.
        subpixels: n of the n x n fixed positions in a pixel.
        exposure_s: time that a moving sensor's views are averaged over (see `starling.sim.geometry.motion`).
        step_px: image motion between one of these views and the next.

    Returns:
        Layers with zero indirect light (see `starling.sim.render.indirect`).
    """
    scene, (stage, sensor) = stage.scene, placement.in_model(stage, sensor)
    if not backend.is_jit():
        from starling.sim.render import scalar as render_scalar

        motion.refuse_without_compiler(scene.motion)
        return placement.enlarged(render_scalar.layers(stage, sensor, subpixels=subpixels), scene)
    left, right = cameras(sensor, stage.scene.world_from_left)
    lights = Lights.of(stage, sensor)
    paths = motion.paths(stage, sensor, left, exposure_s, step_px=step_px)
    truth = _truth(stage, left, right, lights.projector)
    centres = (truth.depth_m, truth.material)  # The truth is the left imager's.
    rendered = Layers(
        left=_view(stage, left, lights, subpixels, paths[0], centres),
        right=None
        if sensor.kind == "structured_light"
        else _view(stage, right, lights, subpixels, paths[1], _centres(stage, right)),
        truth=truth,
    )
    return placement.enlarged(rendered, scene)


def view(stage: Stage, sensor: Sensor, *, subpixels: int = 2) -> View:
    """Render what the left imager alone receives, at rest.

    Args:
        stage, sensor, subpixels: as `layers`.
    """
    if not backend.is_jit():
        from starling.sim.render import scalar as render_scalar

        return render_scalar.view(stage, sensor, subpixels=subpixels)
    left, _ = cameras(sensor, stage.scene.world_from_left)
    return _view(stage, left, Lights.of(stage, sensor), subpixels, None, _centres(stage, left))


def _view(
    stage: Stage,
    camera: Camera,
    lights: Lights,
    subpixels: int,
    path: motion.Path | None,
    centres: tuple[Image, NDArray[np.uint32]],
) -> View:
    """Average n x n fixed positions a pixel, at more moments where it moves.

    As many moments as memory allows are traced by one launch: to tell Dr.Jit what to do takes
    longer than a small image's rays. Depth and body are those of the pixels' centres (see
    `_centres`), of the glass itself where there is glass.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    shape, count = camera.size[::-1], camera.size[0] * camera.size[1]
    moments = motion.moments(subpixels, path)
    sums = np.zeros((lights.count, *shape), np.float32)
    most = max(1, _RAYS // count)
    for begin in range(0, len(moments), most):
        together = moments[begin : begin + most]
        x, y, time_s = (dr.repeat(mi.Float(each), count) for each in zip(*together, strict=True))
        there, lit = motion.at(path, time_s, camera, lights)
        ray = there.ray(dr.tile(pixels(camera.size), len(together)) + mi.Vector2f(x, y))
        if stage.specular is None:
            seen = lit.returned(stage, stage.mitsuba.ray_intersect(ray))
        else:
            seen = _seen(stage, stage.specular, lit, ray)
        dr.eval(*seen)
        for total, parts in zip(sums, seen, strict=True):
            for part in parts.numpy().reshape(-1, *shape):
                total += part
    direct, ambient, *other = sums * np.float32(1 / len(moments))
    depth, body = centres
    return View(
        projector_direct=direct,
        projector_indirect=np.zeros(shape, np.float32),
        ambient=ambient,
        other=other[0] if other else np.zeros(shape, np.float32),
        depth_m=depth,
        body=body,
    )


def _seen(stage: Stage, specular: Specular, lights: Lights, ray: Any) -> list[Any]:
    """Radiances along rays, with what mirrors show and glass lets through."""
    dr = backend.drjit()

    def returned(si: Any, active: Any) -> list[Any]:
        si.t = dr.select(active, si.t, dr.inf)  # Only active points are asked for light.
        return lights.returned(stage, si)

    return specular.seen(stage.mitsuba, ray, returned, lambda way: lights.sky(stage, way))


def _centres(stage: Stage, camera: Camera) -> tuple[Image, NDArray[np.uint32]]:
    """Depth [m] and body number of what the pixel centres see, each (h, w)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    columns = (
        camera.place.local(si.p).z,
        dr.reinterpret_array(mi.UInt32, si.shape),
        si.is_valid(),
    )
    dr.eval(*columns)
    depth, body, seen = (column.numpy().reshape(camera.size[::-1]) for column in columns)
    return (
        np.where(seen, depth, np.float32(np.nan)).astype(np.float32),
        np.where(seen, stage.numbers[np.minimum(body, len(stage.numbers) - 1)], 0),
    )


def _truth(stage: Stage, left: Camera, right: Camera, light: Light) -> Truth:
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(left.ray(pixels(left.size)))
    hit, normal = si.is_valid(), towards_viewer(si)
    faced = hit & right.sees(si.p)
    sight = between(right.place.origin, si.p, stage.scene.shadow_tolerance)
    place = left.place
    columns = (
        left.place.local(si.p).z,
        *(dr.dot(axis, normal) for axis in (place.x, place.y, place.z)),
        dr.reinterpret_array(mi.UInt32, si.shape),
        faced & ~stage.mitsuba.ray_test(sight, faced),
        light.reaches(stage, si.p, hit),
        hit,
    )
    dr.eval(*columns)
    shape = left.size[::-1]
    depth, nx, ny, nz, body, right_sees, lit, seen = (c.numpy().reshape(shape) for c in columns)
    missing = np.float32(np.nan)
    return Truth(
        depth_m=np.where(seen, depth, missing).astype(np.float32),
        normal=np.where(seen[..., None], np.stack([nx, ny, nz], axis=-1), missing),
        material=np.where(seen, stage.numbers[np.minimum(body, len(stage.numbers) - 1)], 0),
        right_sees=right_sees,
        lit=lit,
    )
