"""A real capture as a scene: its reference depth as surface, its infrared as reflectance."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim.capture import open_set
from sim.capture_info import CaptureInfo
from sim.optics import shading
from sim.pinhole import Pinhole
from sim.scene import Material, Scene
from sim.scenes import depth_surface, dots_off
from sim.sensor import Sensor

Array = NDArray[np.float32]

_MEAN_REFLECTANCE = 0.5  # Assumed: brightness alone cannot tell light from reflectance.


def load(path: Path, sensor: Sensor, *, smoothing_px: float = 0.0) -> Scene:
    """Turn one scene of a capture set into a scene to simulate.

    The infrared image is the reflectance estimate: projector off where that was captured, else
    the image with its dots subtracted (`sim.scenes.dots_off`). What the sensor's own lens darkens
    off the axis is taken out: it comes again when the scene is simulated.

    Args:
        path: the scene's folder.
        sensor: that the captures are of, as far as its left lens's vignetting goes.
        smoothing_px: sigma of a Gaussian that the image is smoothed by as it is, dots and all, so
            that nothing of its detail gets into the scene; 0 takes out the dots instead.

    Raises:
        InputError: if smoothing_px is not 0 to 100, the folder is no scene of a capture set, or
            has no reference depth or no infrared image.
    """
    errors.in_interval("smoothing_px", smoothing_px, 0.0, 100.0, "12 leaves no dots.")
    captures = open_set(path)
    if len(captures.scenes) != 1:
        raise errors.refuse(
            "scene", "must be one scene of a capture set", path, "Name one of its folders."
        )
    scene, info = captures.scenes[0], captures.info
    truth = scene.truth_m()
    frame = scene.frame(scene.frames[0])
    lit = frame.ir_left if frame.ir_left_off is None else frame.ir_left_off
    if truth is None or lit is None:
        raise errors.refuse(
            "scene", "must have truth.png and ir_left.png", path, "Choose a scene with both."
        )
    level = np.maximum(lit.astype(np.float32) - np.float32(info.black_level_dn or 0.0), 0)
    if smoothing_px > 0:
        level = np.asarray(cv2.GaussianBlur(level, (0, 0), smoothing_px), np.float32)
    elif frame.ir_left_off is None:
        level = np.maximum(dots_off.removed(level), 0)
    return depth_surface.scene(
        scene.name,
        info.disparity_px(truth),
        info,
        Material(name="as seen"),
        reflectance=_reflectance(level / _seen_share(info, sensor)),
    )


def _seen_share(info: CaptureInfo, sensor: Sensor) -> Array:
    """Share of the light that the lens lets through off the axis, (h, w)."""
    return shading.vignetting(sensor.left.lens.vignetting, Pinhole.of(info))


def _reflectance(level: Array) -> Array:
    """Estimate reflectance (h, w) from the level of infrared, up to an assumed mean."""
    scale = _MEAN_REFLECTANCE / max(float(level.mean()), 1e-6)
    return np.clip(level * np.float32(scale), 0.01, 0.95).astype(np.float32)
