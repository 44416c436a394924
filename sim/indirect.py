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

from sim import backend, frames, plugin_scene, projector
from sim.frames import Pose
from sim.layers import Image, Layers
from sim.sensor import Sensor
from sim.stage import Stage

_SHRINK = 4
_BOUNCES = 4  # Surfaces on the longest path; more add under a hundredth in rooms.
_DOT_MEAN_PX = 30.0  # Sigma over which the pattern is averaged, in its own pixels.
_SIGMA_PX = 5.0  # Of the low-pass, in coarse pixels.
_OTHER_DEPTH = 0.05  # Relative step of depth, and
_OTHER_NORMAL = 0.3  # step of a normal's component, that mean another surface.
_LEAST_ALBEDO = 0.02  # Darker surfaces return too little to divide by.


def add(layers: Layers, stage: Stage, sensor: Sensor, *, samples: int, seed: int) -> Layers:
    """Add the indirect layer to both views.

    Args:
        layers: as rendered directly.
        stage: the same scene.
        sensor: the same sensor.
        samples: paths a coarse pixel.
        seed: of the sampler.
    """
    pattern = projector.irradiance_at_unit_distance(sensor.projector)
    spread = cv2.GaussianBlur(pattern, (0, 0), _DOT_MEAN_PX)
    # A surface lit by its neighbours cannot tell dots from their mean, but samples can.
    lit = plugin_scene.lit(stage, sensor, np.asarray(spread, np.float32))
    left = stage.scene.world_from_left
    right = frames.right_of(left, sensor.baseline_m)
    views = []
    for number, (view, pose) in enumerate(((layers.left, left), (layers.right, right))):
        image = _view(stage, lit, sensor, pose, samples, 2 * seed + number)
        views.append(dataclasses.replace(view, projector_indirect=image))
    return dataclasses.replace(layers, left=views[0], right=views[1])


def _view(stage: Stage, lit: Any, sensor: Sensor, pose: Pose, samples: int, seed: int) -> Image:
    mi = backend.mitsuba()
    sampler = {"type": "independent", "sample_count": samples}
    coarse = plugin_scene.camera(sensor, pose, sampler=sampler, shrink=_SHRINK)
    images = []
    for bounces in (_BOUNCES, 1):  # Equal seeds: the direct light is the same bits in both.
        integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "hide_emitters": True})
        image = mi.render(lit, sensor=coarse, integrator=integrator, spp=samples, seed=seed % 2**31)
        images.append(np.array(image)[..., 0].astype(np.float32))
    sampled = np.maximum(images[0] - images[1], 0)
    low_albedo, low_guide = _surfaces(stage, sensor, pose, _SHRINK)
    irradiance = _low_passed(sampled / np.maximum(low_albedo, _LEAST_ALBEDO), low_guide)
    albedo, guide = _surfaces(stage, sensor, pose, 1)
    return albedo * _raised(irradiance, low_guide, guide)


def _surfaces(stage: Stage, sensor: Sensor, pose: Pose, shrink: int) -> tuple[Image, Image]:
    """Albedo (h, w), and (h, w, 3) depth and normal in units in which 1 means another surface."""
    mi = backend.mitsuba()
    camera = plugin_scene.camera(sensor, pose, sampler=plugin_scene.fixed(1), shrink=shrink)
    integrator = mi.load_dict({"type": "aov", "aovs": "p:position,n:sh_normal,a:albedo"})
    image = np.array(mi.render(stage.mitsuba, sensor=camera, integrator=integrator, spp=1))
    depth = np.maximum((image[..., 0:3] - pose[:3, 3]) @ pose[:3, 2], 1e-3)
    normal = np.abs(image[..., 3:6] @ pose[:3, :2])  # The sign is the winding's, not the side's.
    guide = np.concatenate(
        [np.log(depth)[..., None] / _OTHER_DEPTH, normal / _OTHER_NORMAL], axis=-1
    )
    return np.minimum(image[..., 6], 1).astype(np.float32), guide.astype(np.float32)


def _low_passed(image: Image, guide: Image) -> Image:
    """Joint bilateral filter: average over neighbours on the same surface."""
    smooth = cv2.ximgproc.jointBilateralFilter(guide, image.astype(np.float32), -1, 1.0, _SIGMA_PX)
    return np.asarray(smooth, np.float32)


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
