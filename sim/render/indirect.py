"""The projector's light after two or more bounces: coarse path tracing and joint upsampling.

This light is smooth over a surface, so it is sampled at a quarter of the resolution. It is divided
by the albedo, low-passed within edges of depth and normal, upsampled, and multiplied by the albedo.
Without the low-pass, Monte-Carlo noise would differ between the imagers and cause false holes.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.geometry import frames, placement
from starling.sim.render import backend, emission, paths, scalar, upsampling
from starling.sim.render.beam import FocusedPattern
from starling.sim.render.layers import Layers
from starling.sim.render.lights import Lights
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitPose, reduced
from starling.sim.sensor.sensor import Sensor

_SHRINK = 4  # Reduction of the resolution of path tracing.
_DOT_SHRINK = 8  # Reduction of the averaged pattern's resolution.
_DOT_MEAN_PX = 4.0  # Sigma of the pattern's average [reduced px].
_SIGMA_PX = 5.0  # Sigma of the low-pass at `_SAMPLES` paths per pixel [coarse px].
_SAMPLES = 16  # Paths per pixel for `_SIGMA_PX`; fewer paths widen the low-pass.
_LEAST_ALBEDO = 0.02  # Least divisor; darker surfaces reflect too little light.


def add(
    layers: Layers, mi_scene: MitsubaScene, sensor: Sensor, *, samples: int, seed: int
) -> Layers:
    """Add the indirect layer to both views, for a sensor at rest.

    Args:
        layers: Direct layers.
        mi_scene: Scene of the layers.
        sensor: Sensor of the layers.
        samples: Paths per coarse pixel.
        seed: Seed of the paths.
    """
    scene, (mi_scene, sensor) = mi_scene.scene, placement.rig_in_model(mi_scene, sensor)
    part = sensor.projector
    irradiances = [
        _without_dots(emission.irradiance_at_unit_distance(part, number))
        for number in range(len(emission.emitters(part)))
    ]
    render = _trace_jit if backend.is_jit() else _trace_scalar
    share = np.float32(1 / scene.model_error.scale**2)  # See `placement.scale_layers`.
    images = [image * share for image in render(mi_scene, sensor, irradiances, samples, seed)]
    views = (layers.left, layers.right)[: len(images)]
    left, *right = (
        dataclasses.replace(view, projector_indirect=image)
        for view, image in zip(views, images, strict=True)
        if view is not None
    )
    return dataclasses.replace(layers, left=left, right=right[0] if right else None)


def _without_dots(irradiance: Image) -> Image:
    """Average the pattern: it hardly changes indirect light, but reduces the noise."""
    height, width = irradiance.shape
    size = (max(width // _DOT_SHRINK, 1), max(height // _DOT_SHRINK, 1))
    small = cv2.resize(irradiance, size, interpolation=cv2.INTER_AREA)
    mean = cv2.GaussianBlur(small, (0, 0), _DOT_MEAN_PX, borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, np.float32)


def _trace_jit(
    mi_scene: MitsubaScene, sensor: Sensor, irradiances: list[Image], samples: int, seed: int
) -> list[Image]:
    """Indirect light of the imagers by `starling.sim.render.paths`."""
    lights = Lights.from_sensor(mi_scene, sensor)
    averaged = [FocusedPattern(irradiance) for irradiance in irradiances]
    emissions = tuple(
        dataclasses.replace(emitted, pattern=pattern)
        for emitted, pattern in zip(lights.projector.emissions, averaged, strict=True)
    )
    mean = dataclasses.replace(lights.projector, emissions=emissions)
    lights = dataclasses.replace(lights, projector=mean, other_projector=None, sun=None)
    images = []
    for side, pose in _poses(mi_scene, sensor).items():
        draw = randomness.generator(seed, 0, "scene", f"interreflection {side}")
        place = JitPose.from_pose(pose)
        coarse, fine = (reduced(sensor, place, shrink) for shrink in (_SHRINK, 1))
        sampled = paths.radiance(mi_scene, coarse, lights, samples, int(draw.integers(2**63)))
        surfaces = [paths.surfaces(mi_scene, camera) for camera in (coarse, fine)]
        images.append(_smooth(sampled, surfaces[0], surfaces[1], samples))
    return images


def _trace_scalar(
    mi_scene: MitsubaScene, sensor: Sensor, irradiances: list[Image], samples: int, seed: int
) -> list[Image]:
    """Indirect light of the imagers by Mitsuba's path tracer."""
    images = []
    for number, pose in enumerate(_poses(mi_scene, sensor).values()):
        sampled = scalar.radiance(
            mi_scene,
            sensor,
            pose,
            irradiances,
            shrink=_SHRINK,
            samples=samples,
            seed=(2 * seed + number) % 2**31,
        )
        coarse, fine = (
            scalar.surfaces(mi_scene, sensor, pose, shrink=shrink) for shrink in (_SHRINK, 1)
        )
        images.append(_smooth(sampled, coarse, fine, samples))
    return images


def _poses(mi_scene: MitsubaScene, sensor: Sensor) -> dict[str, frames.Pose]:
    """Poses of the imagers by side."""
    left = mi_scene.scene.world_from_left
    if sensor.kind == "structured_light":
        return {"left": left}
    return {"left": left, "right": frames.right_of(left, sensor.baseline_m)}


def _smooth(sampled: Image, coarse: paths.Surfaces, fine: paths.Surfaces, samples: int) -> Image:
    """Low-pass and upsample the light at unit albedo, then apply the albedo."""
    irradiance = np.asarray(sampled / np.maximum(coarse.albedo, _LEAST_ALBEDO), np.float32)
    low, sigma_px = upsampling.guide(coarse), _SIGMA_PX * (_SAMPLES / samples) ** 0.25
    smooth = upsampling.low_pass(irradiance, low, sigma_px)
    return fine.albedo * upsampling.upsample(smooth, low, upsampling.guide(fine))
