"""The stored reference of a structured-light camera: its own pattern, seen without parallax."""

from __future__ import annotations

import cv2
import numpy as np

from sim import frames, projector
from sim.imager import Infrared, digital
from sim.optics.blur import blur
from sim.sensor import Sensor

_OVERSAMPLING = 3


def image(sensor: Sensor) -> Infrared:
    """Image that an imager at the projector's place would have of any scene, without noise.

    Seen from where it is thrown, a pattern looks the same on every surface; so one stored image
    serves as the right view, and disparity = f b / z as in a stereo pair.

    Returns:
        (h, w) in DN, its mean at the level auto exposure aims at.
    """
    part, imager = projector.as_stored(sensor.projector), sensor.left
    fine = _OVERSAMPLING
    u = (np.arange(sensor.width * fine) + 0.5) / fine - 0.5
    v = (np.arange(sensor.height * fine) + 0.5) / fine - 0.5
    x, y = np.meshgrid((u - sensor.cx_px) / sensor.fx_px, (v - sensor.cy_px) / sensor.fy_px)
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ frames.rotation(part.rotation_deg)
    texture = projector.irradiance_at_unit_distance(part)
    height, width = texture.shape
    half_x, half_y = projector.half_tangents(part)
    column = (0.5 * (ray[..., 0] / ray[..., 2] / half_x + 1) * width - 0.5).astype(np.float32)
    row = (0.5 * (ray[..., 1] / ray[..., 2] / half_y + 1) * height - 0.5).astype(np.float32)
    seen = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    light = cv2.resize(seen, (sensor.width, sensor.height), interpolation=cv2.INTER_AREA)
    light = blur(np.asarray(light, np.float32), imager.lens.blur_px)
    aim = max(imager.auto_exposure_level, 0.1) * imager.ceiling_dn
    level = light * np.float32(aim / max(float(light.mean()), 1e-30)) + imager.black_level_dn
    return digital(imager, level)
