"""Direct light of scene and sensor, without Monte-Carlo noise.

Each pixel is sampled at n x n fixed sub-pixel positions (box filter). One ray from the imager finds
the surface. One ray *from the projector* tests its light, so that a noisy surface does not shadow
itself. Rays continue through mirrors and glass (`starling.sim.render.mirrors_and_glass`). Without
a compiler, `starling.sim.render.scalar` renders the same layers with Mitsuba's integrators.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry import motion, placement
from starling.sim.render import backend
from starling.sim.render.beam import shadow_ray
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
    seen = _Centres.from_camera(mi_scene, left, lights)
    columns = seen.truth(mi_scene, right)  # The truth belongs to the left imager.
    left_view = _view(mi_scene, sensor, seen, lights, subpixels, paths[0], columns.values)
    right_view = None
    if sensor.kind != "structured_light":
        faced = _Centres.from_camera(mi_scene, right, lights)
        right_view = _view(mi_scene, sensor, faced, lights, subpixels, paths[1])
    rendered = Layers(left=left_view, right=right_view, truth=columns.read(left_view))
    return placement.scale_layers(rendered, scene)


def view(mi_scene: MitsubaScene, sensor: Sensor, *, subpixels: int = 2) -> ViewLayers:
    """Render the left imager alone, at rest (arguments as `layers`)."""
    if not backend.is_jit():
        from starling.sim.render import scalar

        return scalar.view(mi_scene, sensor, subpixels=subpixels)
    left, _ = cameras(sensor, mi_scene.scene.world_from_left)
    lights = Lights.from_sensor(mi_scene, sensor)
    seen = _Centres.from_camera(mi_scene, left, lights)
    return _view(mi_scene, sensor, seen, lights, subpixels, None)


@dataclass(frozen=True, slots=True)
class _Centres:
    """Surface points at a camera's pixel centres. Dr.Jit computes only what is read of them."""

    camera: JitCamera
    si: Any
    depth: Any  # Float [m]
    handle: Any  # UInt32: Dr.Jit's shape handle.
    valid: Any  # Bool
    shares: list[Any]  # Share of each emitter's light of the projector that arrives.

    @staticmethod
    def from_camera(mi_scene: MitsubaScene, camera: JitCamera, lights: Lights) -> _Centres:
        mi, dr = backend.mitsuba(), backend.drjit()
        si = mi_scene.seen(camera.ray(pixels(camera.size)))
        return _Centres(
            camera=camera,
            si=si,
            depth=camera.place.local(si.p).z,
            handle=dr.reinterpret_array(mi.UInt32, si.shape),
            valid=si.is_valid(),
            shares=lights.projector.shares(mi_scene, si, coherent=True),
        )

    def truth(self, mi_scene: MitsubaScene, right: JitCamera) -> _TruthColumns:
        """Ground truth of the left imager."""
        dr, place = backend.drjit(), self.camera.place
        normal = towards_viewer(self.si)
        faced = self.valid & right.sees(self.si.p)
        sight = shadow_ray(right.place.origin, self.si.p, mi_scene.scene.shadow_tolerance)
        return _TruthColumns(
            seen=self,
            normal=tuple(dr.dot(axis, normal) for axis in (place.x, place.y, place.z)),
            right_sees=faced & ~mi_scene.mitsuba.ray_test(sight, True, faced),
            lit=reduce(operator.or_, (share > 0 for share in self.shares)),
        )

    def read(self, mi_scene: MitsubaScene) -> tuple[Image, NDArray[np.uint32]]:
        """Depth [m] and body number, each (h, w)."""
        depth, handle, valid = map(self.image, (self.depth, self.handle, self.valid))
        known = np.where(valid, depth, np.float32(np.nan)).astype(np.float32)
        return known, mi_scene.body_numbers(handle, valid)

    def image(self, column: Any) -> NDArray[Any]:
        """A column (h, w)."""
        return column.numpy().reshape(self.camera.size[::-1])


@dataclass(frozen=True, slots=True)
class _TruthColumns:
    """Ground truth at the left imager's pixel centres, as values of Dr.Jit."""

    seen: _Centres
    normal: tuple[Any, ...]  # Components in the left frame.
    right_sees: Any
    lit: Any

    @property
    def values(self) -> tuple[Any, ...]:
        """Values to compute."""
        return *self.normal, self.right_sees, self.lit

    def read(self, view: ViewLayers) -> Truth:
        """The ground truth as images, with depth and bodies of the left imager's view."""
        *normal, right_sees, lit = map(self.seen.image, self.values)
        hit = np.isfinite(view.depth_m)[..., None]
        return Truth(
            depth_m=view.depth_m,
            normal=np.where(hit, np.stack(normal, axis=-1), np.float32(np.nan)),
            material=view.body,
            right_sees=right_sees,
            lit=lit,
        )


def _view(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    seen: _Centres,
    lights: Lights,
    subpixels: int,
    path: motion.ExposureMotion | None,
    further: tuple[Any, ...] = (),
) -> ViewLayers:
    """Average n x n fixed positions per pixel, and several times for a moving sensor.

    One launch traces as many samples as memory allows, since a launch takes longer than the rays
    of a small image. Depth and body belong to the pixels' centres; on glass they are those of the
    glass. A single position is the centre, whose ray is not traced twice.

    Args:
        mi_scene: Scene to render.
        sensor: Sensor of the imager.
        seen: Surface points at the pixels' centres.
        lights: Lights of the scene.
        subpixels: n.
        path: Motion of a moving sensor.
        further: Columns to compute in the same launch.
    """
    dr, camera = backend.drjit(), seen.camera
    shape, count = camera.size[::-1], camera.size[0] * camera.size[1]
    moments = motion.moments(subpixels, path)
    sums = np.zeros((lights.count, *shape), np.float32)
    most = max(1, _RAYS // count)
    centres = seen.depth, seen.handle, seen.valid
    for begin in range(0, len(moments), most):
        batch = moments[begin : begin + most]
        if batch == [motion.CENTRE] and mi_scene.specular is None:
            radiances = lights.reflected(mi_scene, seen.si, seen.shares)
        else:
            radiances = _radiances(mi_scene, camera, lights, path, batch)
        dr.eval(*radiances, *centres, *further)
        for total, parts in zip(sums, radiances, strict=True):
            for part in parts.numpy().reshape(-1, *shape):
                total += part
    direct, ambient, *rest = sums * np.float32(1 / len(moments))
    if mi_scene.scene.ambient.occlusion:
        from starling.sim.render import occlusion

        ambient *= occlusion.ambient_factor(mi_scene, sensor, camera.place)
    depth, body = seen.read(mi_scene)
    return ViewLayers(
        projector_direct=direct,
        projector_indirect=np.zeros(shape, np.float32),
        ambient=ambient,
        other=rest[0] if rest else np.zeros(shape, np.float32),
        depth_m=depth,
        body=body,
    )


def _radiances(
    mi_scene: MitsubaScene,
    camera: JitCamera,
    lights: Lights,
    path: motion.ExposureMotion | None,
    batch: list[tuple[float, float, float]],
) -> list[Any]:
    """Radiances of each light at positions and times of an exposure, one after the other."""
    mi, dr = backend.mitsuba(), backend.drjit()
    count = camera.size[0] * camera.size[1]
    x, y, time_s = (dr.repeat(mi.Float(column), count) for column in zip(*batch, strict=True))
    posed, posed_lights = motion.at_time(path, time_s, camera, lights)
    ray = posed.ray(dr.tile(pixels(camera.size), len(batch)) + mi.Vector2f(x, y))
    if mi_scene.specular is None:
        si = mi_scene.seen(ray)
        shares = posed_lights.projector.shares(mi_scene, si, coherent=True)
        return posed_lights.reflected(mi_scene, si, shares)
    return _with_mirrors_and_glass(mi_scene, mi_scene.specular, posed_lights, ray)


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
