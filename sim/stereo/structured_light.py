"""Structured light: the stored reference image of the pattern, and matching against it."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.imaging.imager import Infrared, quantise_matched
from starling.sim.imaging.optics.spot import blur
from starling.sim.render import emission
from starling.sim.sensor.sensor import Sensor

if TYPE_CHECKING:  # The import loads numba.
    from starling.sim.stereo.disparity import DisparityMap

_OVERSAMPLING = 3  # Samples of the pattern per pixel and axis.


def reference_image(sensor: Sensor, *, beyond_px: int = 0) -> Infrared:
    """Render the noise-free image of an imager at the projector's position.

    From the projector's position the pattern looks the same on every surface. One stored image
    therefore serves as the right view, and disparity = f b / z as in a stereo pair.

    Args:
        sensor: supplies the projector as it was when the reference was stored, and the lens's spot.
        beyond_px: additional columns on the left, >= 0 [px].

    Returns:
        (h, beyond_px + w) in DN, read-only because it is cached. The mean of its last w columns is
        the target level of auto exposure.

    Raises:
        InputError: if `beyond_px` is not in [0, 8192].
    """
    errors.in_interval("beyond_px", beyond_px, 0, 8192)
    return _image(sensor, beyond_px)


@lru_cache(maxsize=4)
def _image(sensor: Sensor, beyond_px: int) -> Infrared:
    part, imager = emission.reference_projector(sensor.projector), sensor.left
    fine = _OVERSAMPLING
    columns = beyond_px + sensor.width
    u = (np.arange(columns * fine) + 0.5) / fine - 0.5 - beyond_px
    v = (np.arange(sensor.height * fine) + 0.5) / fine - 0.5
    x, y = np.meshgrid((u - sensor.cx_px) / sensor.fx_px, (v - sensor.cy_px) / sensor.fy_px)
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ frames.rotation(part.rotation_deg)
    texture = emission.irradiance_at_unit_distance(part)
    height, width = texture.shape
    half_x, half_y = emission.half_tangents(part)
    column = (0.5 * (ray[..., 0] / ray[..., 2] / half_x + 1) * width - 0.5).astype(np.float32)
    row = (0.5 * (ray[..., 1] / ray[..., 2] / half_y + 1) * height - 0.5).astype(np.float32)
    pattern = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    light = cv2.resize(pattern, (columns, sensor.height), interpolation=cv2.INTER_AREA)
    light = blur(np.asarray(light, np.float32), imager.lens.blur_px)
    aim = max(imager.auto_exposure_level, 0.1) * imager.ceiling_dn
    mean = float(light[:, beyond_px:].mean())
    level = light * np.float32(aim / max(mean, 1e-30)) + imager.black_level_dn
    stored = quantise_matched(imager, level)
    stored.flags.writeable = False
    return stored


def match_reference(ir_left: Infrared, sensor: Sensor) -> DisparityMap:
    """Match the left infrared image against the reference.

    The reference is extended to the left by the search range. A real structured-light camera has
    depth up to the image's left border, at 0.6 m and at 3 m. A stereo pair has none in the first
    columns.

    Args:
        ir_left: (h, w) uint8, or uint16 with the left imager's `matched_bits`.
        sensor: sensor with `kind = "structured_light"`.

    Returns:
        Disparities f b / z of the image [px], (h, w).

    Raises:
        InputError: if the image cannot be matched.
    """
    from starling.sim.stereo.disparity import DisparityMap
    from starling.sim.stereo.matching import darkness, match, readable

    beyond = sensor.matcher.min_disparity_px + sensor.matcher.search_px
    padded = cv2.copyMakeBorder(ir_left, 0, 0, beyond, 0, cv2.BORDER_REPLICATE)
    bits = sensor.left.matched_bits
    stored = readable(reference_image(sensor, beyond_px=beyond), bits)
    seen = readable(np.asarray(padded), bits)
    disparities = match(seen, stored, sensor.matcher, dark=darkness(seen, sensor.left))
    return DisparityMap(
        disparity_px=np.ascontiguousarray(disparities.disparity_px[:, beyond:]),
        valid=np.ascontiguousarray(disparities.valid[:, beyond:]),
        reason=np.ascontiguousarray(disparities.reason[:, beyond:]),
    )
