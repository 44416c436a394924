"""A real capture as a scene: its reference depth as surface, its infrared as reflectance."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim.capture import CapturedScene, open_set
from sim.optics import shading
from sim.pinhole import Pinhole
from sim.scene import Material, Scene
from sim.scenes import depth_surface, dots_off
from sim.scenes.unmixed import unmixed
from sim.sensor import Sensor

Array = NDArray[np.float32]

_MEAN_REFLECTANCE = 0.5  # Assumed: brightness alone cannot tell light from reflectance.


def load(
    path: Path, sensor: Sensor, *, smoothing_px: float = 0.0, within_surfaces: bool = False
) -> Scene:
    """Turn one scene of a capture set into a scene to simulate.

    The infrared image is the reflectance estimate: projector off where that was captured, else
    the image with its dots subtracted (`sim.scenes.dots_off`). What the sensor's own lens darkens
    off the axis is taken out: it comes again when the scene is simulated.

    Args:
        path: the scene's folder.
        sensor: that the captures are of, as far as its left lens's vignetting goes.
        smoothing_px: sigma of a Gaussian that the image is smoothed by as it is, dots and all, so
            that nothing of its detail gets into the scene; 0 takes out the dots instead.
        within_surfaces: what the Gaussian mixed across depth edges is parted again, by means of the
            reference depth alone (`sim.scenes.unmixed`).

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
    if truth is None:
        raise _incomplete(path)
    disparity_px = info.disparity_px(truth)
    seen = reflectance(
        scene,
        vignetting=sensor.left.lens.vignetting,
        smoothing_px=smoothing_px,
        surfaces_px=disparity_px if within_surfaces else None,
    )
    return of_reflectance(scene, disparity_px, seen)


def of_reflectance(scene: CapturedScene, disparity_px: Array, reflectance: Array) -> Scene:
    """Turn a captured scene's reference into a scene, whatever its reflectance is taken for.

    Args:
        scene: of a capture set.
        disparity_px: (h, w) its reference; NaN where unknown.
        reflectance: (h, w).
    """
    return depth_surface.scene(
        scene.name, disparity_px, scene.info, Material(name="as seen"), reflectance=reflectance
    )


def reflectance(
    scene: CapturedScene,
    *,
    vignetting: float = 0.0,
    smoothing_px: float = 0.0,
    surfaces_px: Array | None = None,
) -> Array:
    """Estimate reflectance (h, w) from the first infrared image, up to an assumed mean.

    Args:
        scene: of a capture set.
        vignetting: exponent of the left lens's (see `sim.parts.imager.Lens`), which is taken out.
        smoothing_px: as in `load`.
        surfaces_px: (h, w) reference disparity, at whose jumps the smoothed image is parted.

    Raises:
        InputError: if there is no infrared image.
    """
    info, frame = scene.info, scene.frame(scene.frames[0])
    lit = frame.ir_left if frame.ir_left_off is None else frame.ir_left_off
    if lit is None:
        raise _incomplete(scene.path)
    level = np.maximum(lit.astype(np.float32) - np.float32(info.black_level_dn or 0.0), 0)
    if smoothing_px > 0:
        level = np.asarray(cv2.GaussianBlur(level, (0, 0), smoothing_px), np.float32)
        if surfaces_px is not None:
            level = unmixed(level, surfaces_px, smoothing_px)
    elif frame.ir_left_off is None:
        level = np.maximum(dots_off.removed(level), 0)
    level = level / shading.vignetting(vignetting, Pinhole.of(info))
    scale = _MEAN_REFLECTANCE / max(float(level.mean()), 1e-6)
    return np.clip(level * np.float32(scale), 0.01, 0.95).astype(np.float32)


def _incomplete(path: Path) -> errors.InputError:
    return errors.refuse(
        "scene", "must have truth.png and ir_left.png", path, "Choose a scene with both."
    )
