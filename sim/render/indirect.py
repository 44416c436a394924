"""The projector's light after two bounces and more: path-traced coarsely, low-passed, raised.

This light is smooth over a surface, so it is sampled on a quarter of the pixels a side, divided
by the albedo, low-passed without crossing edges of depth or normal, and multiplied by the albedo
again. Left to itself its noise would differ between the imagers, and such noise makes holes that
no camera has.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np

from starling.sim import randomness
from starling.sim.geometry import frames, placement
from starling.sim.render import backend, paths, paths_scalar
from starling.sim.render import emission as projector
from starling.sim.render.layers import Image, Layers
from starling.sim.render.lights import Lights
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Camera, Placed, opaque
from starling.sim.sensor.sensor import Sensor

_SHRINK = 4
_DOT_SHRINK = 8  # A pattern without dots needs no more than an eighth of its pixels a side.
_DOT_MEAN_PX = 4.0  # Sigma over which it is averaged, in these pixels.
_SIGMA_PX = 5.0  # Of the low-pass, in coarse pixels, at this many
_SAMPLES = 16  # paths a pixel; fewer are averaged over more pixels.
_OTHER_DEPTH = 0.05  # Relative step of depth, and
_OTHER_NORMAL = 0.3  # step of a normal's component, that mean another surface.
_LEAST_ALBEDO = 0.02  # Darker surfaces return too little to divide by.


def add(layers: Layers, stage: Stage, sensor: Sensor, *, samples: int, seed: int) -> Layers:
    """Add the indirect layer to both views, of a sensor that keeps still.

    Args:
        layers: as rendered directly.
        stage: the same scene.
        sensor: the same sensor.
        samples: paths a coarse pixel.
        seed: of the paths.
    """
    scene, (stage, sensor) = stage.scene, placement.in_model(stage, sensor)
    part = sensor.projector
    irradiances = [
        _without_dots(projector.irradiance_at_unit_distance(part, number))
        for number in range(len(projector.emitters(part)))
    ]
    make = _traced if backend.is_jit() else _plugged
    share = np.float32(1 / scene.model_error.scale**2)  # See `placement.enlarged`.
    made = [image * share for image in make(stage, sensor, irradiances, samples, seed)]
    views = (layers.left, layers.right)[: len(made)]
    left, *right = (
        dataclasses.replace(view, projector_indirect=image)
        for view, image in zip(views, made, strict=True)
        if view is not None
    )
    return dataclasses.replace(layers, left=left, right=right[0] if right else None)


def _without_dots(irradiance: Image) -> Image:
    """Average the pattern: a surface lit by its neighbours cannot tell, but samples can."""
    height, width = irradiance.shape
    size = (max(width // _DOT_SHRINK, 1), max(height // _DOT_SHRINK, 1))
    small = cv2.resize(irradiance, size, interpolation=cv2.INTER_AREA)
    mean = cv2.GaussianBlur(small, (0, 0), _DOT_MEAN_PX, borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, np.float32)


class _Averaged:
    """A pattern without dots, in place of the projector's own."""

    def __init__(self, irradiance: Image) -> None:
        mi = backend.mitsuba()
        self._texture = mi.Texture2f(mi.TensorXf(irradiance[..., None]), use_accel=False)

    def irradiance(self, texel: Any, _depth: Any, active: Any) -> Any:
        return self._texture.eval(texel, active)[0]


def _traced(
    stage: Stage, sensor: Sensor, irradiances: list[Image], samples: int, seed: int
) -> list[Image]:
    """The imagers' views by own rays."""
    lights = Lights.of(stage, sensor)
    averaged: list[Any] = [_Averaged(irradiance) for irradiance in irradiances]
    emissions = tuple(
        dataclasses.replace(emission, pattern=pattern)
        for emission, pattern in zip(lights.projector.emissions, averaged, strict=True)
    )
    mean = dataclasses.replace(lights.projector, emissions=emissions)
    lights = dataclasses.replace(lights, projector=mean, other=None, sun=None)
    images = []
    for side, pose in _poses(stage, sensor).items():
        draw = randomness.generator(seed, 0, "scene", f"interreflection {side}")
        place = Placed.of(pose)
        coarse, fine = (_camera(sensor, place, shrink) for shrink in (_SHRINK, 1))
        sampled = paths.radiance(stage, coarse, lights, samples, int(draw.integers(2**63)))
        seen = [paths.surfaces(stage, camera) for camera in (coarse, fine)]
        images.append(_smooth(sampled, seen[0], seen[1], samples))
    return images


def _plugged(
    stage: Stage, sensor: Sensor, irradiances: list[Image], samples: int, seed: int
) -> list[Image]:
    """The imagers' views by Mitsuba's path tracer."""
    images = []
    for number, pose in enumerate(_poses(stage, sensor).values()):
        sampled = paths_scalar.radiance(
            stage,
            sensor,
            pose,
            irradiances,
            shrink=_SHRINK,
            samples=samples,
            seed=(2 * seed + number) % 2**31,
        )
        coarse, fine = (
            paths_scalar.surfaces(stage, sensor, pose, shrink=shrink) for shrink in (_SHRINK, 1)
        )
        images.append(_smooth(sampled, coarse, fine, samples))
    return images


def _poses(stage: Stage, sensor: Sensor) -> dict[str, frames.Pose]:
    """Poses of the imagers there are."""
    left = stage.scene.world_from_left
    if sensor.kind == "structured_light":
        return {"left": left}
    return {"left": left, "right": frames.right_of(left, sensor.baseline_m)}


def _camera(sensor: Sensor, place: Placed, shrink: int) -> Camera:
    """One imager, its image smaller by a factor; it sees the same field."""
    width, height = sensor.width // shrink, sensor.height // shrink
    x, y = width / sensor.width, height / sensor.height
    return Camera(
        size=(width, height),
        focal=opaque("Vector2f", (sensor.fx_px * x, sensor.fy_px * y)),
        centre=opaque("Vector2f", ((sensor.cx_px + 0.5) * x - 0.5, (sensor.cy_px + 0.5) * y - 0.5)),
        place=place,
    )


def _smooth(sampled: Image, coarse: paths.Surfaces, fine: paths.Surfaces, samples: int) -> Image:
    """Low-pass what a unit albedo would return, raise it to the fine size, and dim it again."""
    irradiance = np.asarray(sampled / np.maximum(coarse.albedo, _LEAST_ALBEDO), np.float32)
    low, sigma_px = _guide(coarse), _SIGMA_PX * (_SAMPLES / samples) ** 0.25
    return fine.albedo * _raised(_low_passed(irradiance, low, sigma_px), low, _guide(fine))


def _guide(seen: paths.Surfaces) -> Image:
    """Depth and normal (h, w, 3) in units in which 1 means another surface."""
    depth = np.log(np.maximum(seen.depth_m, np.float32(1e-3)))[..., None]
    turned = seen.normal[..., :2]
    return np.concatenate([depth / _OTHER_DEPTH, turned / _OTHER_NORMAL], -1, dtype=np.float32)


def _low_passed(image: Image, guide: Image, sigma_px: float) -> Image:
    """Average over neighbours on the same surface, and once more over what that took away.

    Light that rises towards a corner is averaged with darker neighbours only; the second pass
    gives most of it back.

    Source: joint bilateral filter; the second pass is Tukey's "twicing" (Exploratory Data
    Analysis, 1977, sec. 16).
    """
    smooth = cv2.ximgproc.jointBilateralFilter(guide, image, -1, 1.0, sigma_px)
    rest = cv2.ximgproc.jointBilateralFilter(guide, image - smooth, -1, 1.0, sigma_px)
    return np.asarray(np.maximum(smooth + rest, 0), np.float32)


def _raised(coarse: Image, coarse_guide: Image, guide: Image) -> Image:
    """Interpolate to the guide's size between the coarse pixels on the same surface.

    Source: Kopf et al., Joint bilateral upsampling, 2007, eq. 3.
    """
    height, width = guide.shape[:2]
    rows, columns = coarse.shape
    row = (np.arange(height, dtype=np.float32) + 0.5) * (rows / height) - 0.5
    column = (np.arange(width, dtype=np.float32) + 0.5) * (columns / width) - 0.5
    total, weights = np.zeros((2, height, width), np.float32)
    for down, across in np.ndindex(2, 2):
        i, j = np.floor(row).astype(int) + down, np.floor(column).astype(int) + across
        near = np.outer(1 - np.abs(row - i), 1 - np.abs(column - j)).astype(np.float32)
        cell = np.ix_(np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1))
        apart = np.abs(guide - coarse_guide[cell]).sum(axis=-1)
        weight = (near + 1e-3) * (np.exp(-0.5 * apart**2) + np.float32(1e-6))
        total += weight * coarse[cell]
        weights += weight
    return total / weights
