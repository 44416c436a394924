"""Direct and indirect light by Mitsuba's integrators, for the scalar variant.

It is slow, but an independent check of `starling.sim.render.direct` and `paths`: a test compares
them. Shadow rays start at the surface, so a noisy surface may shadow itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Mask
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, emission, plugin_scene, skylight
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.paths import Surfaces
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Projector, Sensor

_AOVS = "p:position,n:sh_normal,a:albedo,i:shape_index"


def layers(mi_scene: MitsubaScene, sensor: Sensor, *, subpixels: int) -> Layers:
    """As `starling.sim.render.direct.layers`, in any variant.

    Raises:
        BackendError: if the scene has lights or surfaces that this variant does not support.
    """
    _refuse_unsupported(mi_scene.scene, sensor)
    left = mi_scene.scene.world_from_left
    right = frames.right_of(left, sensor.baseline_m)
    lit = _lit(mi_scene, sensor)
    seen_left, seen_right = (_PixelCentres(mi_scene, sensor, pose) for pose in (left, right))
    return Layers(
        left=_view(mi_scene, sensor, lit, left, seen_left, subpixels),
        right=None
        if sensor.kind == "structured_light"
        else _view(mi_scene, sensor, lit, right, seen_right, subpixels),
        truth=_truth(mi_scene, sensor, seen_left),
    )


def view(mi_scene: MitsubaScene, sensor: Sensor, *, subpixels: int) -> ViewLayers:
    """As `starling.sim.render.direct.view`, in any variant."""
    _refuse_unsupported(mi_scene.scene, sensor)
    left = mi_scene.scene.world_from_left
    lit = _lit(mi_scene, sensor)
    return _view(mi_scene, sensor, lit, left, _PixelCentres(mi_scene, sensor, left), subpixels)


def _refuse_unsupported(scene: Scene, sensor: Sensor) -> None:
    """Refuse lights and surfaces that Mitsuba's direct integrator does not support."""
    kinds = {body.material.kind for body in scene.bodies}
    finish = scene.finish
    needs = {
        "material mirror": "mirror" in kinds,
        "material glass": "glass" in kinds,
        "scene.finish.transparency": finish.transparency > 0,
        "scene.finish.gloss": 0 < finish.gloss < 1,
        "scene.finish.metal": 0 < finish.metal < 1,
        "scene.ambient.occlusion": scene.ambient.occlusion > 0,
        "scene.sun.irradiance_w_m2": scene.sun.irradiance_w_m2 > 0,
        "scene.other_projector.power_w": scene.other_projector.power_w > 0,
        "projector.defocus_mrad_m": sensor.projector.defocus_mrad_m > 0,
        "projector.pattern_scale other than 1": sensor.projector.pattern_scale != 1,
    }
    unsupported = next((name for name, needed in needs.items() if needed), None)
    if unsupported:
        raise backend.BackendError(
            f"{unsupported} must be absent in scalar_rgb; got it in {scene.name}. "
            "Install libllvm19 or set DRJIT_LIBLLVM_PATH for the compiled variant."
        )


class _PixelCentres:
    """Surfaces at the pixel centres of one imager, each (h, w) or (h, w, 3)."""

    def __init__(self, mi_scene: MitsubaScene, sensor: Sensor, world_from_camera: Pose) -> None:
        mi = backend.mitsuba()
        camera = plugin_scene.camera(sensor, world_from_camera, sampler=plugin_scene.fixed(1))
        integrator = mi.load_dict({"type": "aov", "aovs": _AOVS})
        image = np.array(
            mi.render(mi_scene.albedo_scene, sensor=camera, integrator=integrator, spp=1)
        )
        self.point, normal = image[..., 0:3].astype(np.float64), image[..., 3:6]
        self.albedo = np.minimum(image[..., 6], 1)
        self.hit = np.linalg.norm(normal, axis=-1) > 0.5
        self.body = np.where(self.hit, np.rint(image[..., -1]), 0).astype(np.uint32)
        self.share = np.ones_like(self.albedo)  # Ambient share.
        if mi_scene.ambient_share_scene is not None:
            lit = np.array(
                mi.render(mi_scene.ambient_share_scene, sensor=camera, integrator=integrator, spp=1)
            )
            is_body = self.body <= len(mi_scene.scene.bodies)  # Other shapes have no ambient share.
            self.share = np.where(is_body, lit[..., 6] * mi_scene.largest_share, self.share)
        away = self.point - world_from_camera[:3, 3]
        facing = np.einsum("ijk,ijk->ij", normal, away) > 0
        self.normal = np.where(facing[..., None], -normal, normal)
        viewer = -away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
        self.cosine = np.einsum("ijk,ijk->ij", self.normal, viewer)
        across = (
            self.normal * self.cosine[..., None] - viewer
        )  # As in `starling.sim.render.lights`.
        self.across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-6)


def _lit(mi_scene: MitsubaScene, sensor: Sensor) -> list[Any]:
    """One scene per emitter, since Mitsuba's integrator would choose among several at random."""
    part = sensor.projector
    return [
        plugin_scene.lit(
            mi_scene, sensor, emission.irradiance_at_unit_distance(part, number), number
        )
        for number in range(len(emission.emitters(part)))
    ]


def _view(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    lit: list[Any],
    pose: Pose,
    seen: _PixelCentres,
    subpixels: int,
) -> ViewLayers:
    mi = backend.mitsuba()
    integrator = plugin_scene.direct()
    camera = plugin_scene.camera(sensor, pose, sampler=plugin_scene.fixed(subpixels))
    images = [
        np.array(mi.render(scene, sensor=camera, integrator=integrator, spp=subpixels**2))
        for scene in lit
    ]
    direct = np.sum([image[..., 0] for image in images], axis=0)
    return ViewLayers(
        projector_direct=np.ascontiguousarray(direct, np.float32),
        projector_indirect=np.zeros(direct.shape, np.float32),
        ambient=_ambient(mi_scene, seen),
        other=np.zeros(direct.shape, np.float32),
        depth_m=np.where(seen.hit, _local(seen.point, pose)[..., 2], np.nan).astype(np.float32),
        body=seen.body,
    )


def _ambient(mi_scene: MitsubaScene, seen: _PixelCentres) -> NDArray[np.float32]:
    """Reflected radiance of ambient light of 1 W m^-2, as in `starling.sim.render.lights`."""
    scene = mi_scene.scene
    even, along, across = seen.albedo, skylight.MATT_TILT * seen.albedo, np.zeros_like(seen.albedo)
    for number, body in enumerate(scene.bodies, 1):
        table, pixels = skylight.body_table(body, scene.finish), seen.body == number
        if table is not None:
            coefficients = skylight.interpolate(table, seen.cosine[pixels], seen.albedo[pixels])
            even[pixels], along[pixels], across[pixels] = coefficients
    way = seen.normal * along[..., None] + seen.across * across[..., None]
    share = even + way @ np.asarray(scene.ambient.up) * scene.ambient.gradient
    lit = np.maximum(share, 0) * seen.share / np.pi
    return np.where(seen.hit, lit, 0).astype(np.float32)


def _truth(mi_scene: MitsubaScene, sensor: Sensor, seen: _PixelCentres) -> Truth:
    left = mi_scene.scene.world_from_left
    local_left = _local(seen.point, left)
    with np.errstate(divide="ignore", invalid="ignore"):
        column = sensor.fx_px * (local_left[..., 0] - sensor.baseline_m) / local_left[..., 2]
    column = column + sensor.cx_px
    in_image = (column >= -0.5) & (column <= sensor.width - 0.5)
    right_eye = frames.right_of(left, sensor.baseline_m)[:3, 3]
    missing = np.float32(np.nan)
    normal = (seen.normal @ left[:3, :3]).astype(np.float32)
    return Truth(
        depth_m=np.where(seen.hit, local_left[..., 2], missing).astype(np.float32),
        normal=np.where(seen.hit[..., None], normal, missing),
        material=seen.body,
        right_sees=_clear(mi_scene, right_eye, seen.point, seen.hit & in_image),
        lit=_reached(mi_scene, sensor.projector, left, seen),
    )


def _reached(mi_scene: MitsubaScene, part: Projector, left: Pose, seen: _PixelCentres) -> Mask:
    """Whether light of any emitter reaches the surfaces."""
    reached = np.zeros(seen.hit.shape, bool)
    for emitter in emission.emitters(part):
        light = left @ frames.pose(part.position_m, part.rotation_deg)
        light = light @ frames.pose(emitter.offset_m, emitter.rotation_deg)
        local = _local(seen.point, light)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.abs(local[..., :2] / local[..., 2:])
        in_field = (slope <= emission.half_tangents(part)).all(axis=-1) & (local[..., 2] > 0)
        reached |= _clear(mi_scene, light[:3, 3], seen.point, seen.hit & in_field & ~reached)
    return reached


def _local(point: NDArray[np.float64], world_from_part: Pose) -> NDArray[np.float64]:
    return (point - world_from_part[:3, 3]) @ world_from_part[:3, :3]


def _clear(
    mi_scene: MitsubaScene, origin: NDArray, point: NDArray[np.float64], active: Mask
) -> Mask:
    """Whether points are visible from the origin, within the scene's tolerance."""
    mi = backend.mitsuba()
    free = np.zeros(active.shape, bool)
    start = mi.ScalarPoint3f(origin)
    share = 1 - mi_scene.scene.shadow_tolerance
    for row, column in np.argwhere(active):
        way = point[row, column] - origin
        distance = float(np.linalg.norm(way))
        ray = mi.Ray3f(start, mi.ScalarVector3f(way / distance))
        ray.maxt = distance * share
        free[row, column] = not mi_scene.mitsuba.ray_test(ray)
    return free


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
