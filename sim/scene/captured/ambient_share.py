"""Spatial variation of ambient light in a captured room, estimated from the projector's dots.

Near a pixel, on one surface, the image is r (P + E a). Here r is the reflectance, P the projector's
light, E the ambient light, and a the surface's response to ambient light. P is known if the sensor
has the camera's pattern. Brightness alone does not separate r from E. But the image over its local
mean follows P with a mean slope of 1 / (P + E a), which does not depend on r. Highlights and other
causes that change the dots' contrast locally are mistaken for ambient light.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, filled
from starling.sim.imaging.signals import Signals
from starling.sim.scene.captured import depth_surface

_LEVEL_PX = 12.0  # Sigma of the image's local mean [px]; a few dots of a D415 wide.
_AROUND_PX = 24.0  # Sigma of the neighbourhood of the regression on the dots [px].
_DOTS = 100.0  # Approximate number of dots in such a neighbourhood.
_JUMP_PX = 2.0  # Disparity steps well above this separate surfaces [px].
# Displacements of the dots (rows, columns) that errors of depth may cause [px].
_OFF_PX = tuple((y, x) for y in (-1, 0, 1) for x in (-2, -1, 0, 1, 2))
_SLIVER_PX = 5  # Side of the median filter that removes regions too small for an estimate [px].
_AGREE = 0.3  # Least median correlation with the dots; with a known pattern it is 0.7.
_VARIES = 0.7  # Prior standard deviation of the slope, relative to that in even light.
_DARK_DN = 1.0  # Uncertainty of black level and veiling glare [DN].
_DARKEST = 1e-3  # Least ambient light, relative to the projector's; less does not matter.
_LEAST, _MOST = 0.1, 10.0  # Range of the estimate, relative to its typical value.


def estimate(dotted: Image, light: Signals, disparity_px: Image) -> Image | None:
    """Estimate ambient light relative to its median.

    Args:
        dotted: (h, w) image with dots [DN above black].
        light: Mean signals of the image's imager on surfaces of one reflectance.
        disparity_px: (h, w) reference, NaN where unknown; known somewhere.

    Returns:
        (h, w), nearly 1 where there are few dots. None if the image's dots do not match `light`.
    """
    if not light.laser.any():
        return None
    surface_px = depth_surface.smooth(depth_surface.close_holes(disparity_px))
    guide = np.ascontiguousarray(filled(surface_px, np.isfinite(surface_px)), np.float32)
    laser = np.asarray(light.laser / np.mean(light.laser), np.float32)
    response = np.asarray(light.ambient / np.mean(light.laser), np.float32)
    level = _mean(dotted, guide, _LEVEL_PX)
    relative = np.asarray(
        dotted / np.maximum(level, 1e-3 * float(dotted.mean()) + 1e-6), np.float32
    )
    dots = laser - _mean(laser, guide, _LEVEL_PX)
    detail = relative - _mean(relative, guide, _LEVEL_PX)
    dot_power, detail_power, mean_laser, mean_response = (
        _mean(image, guide, _AROUND_PX) for image in (dots * dots, detail * detail, laser, response)
    )
    scale = np.sqrt(np.maximum(dot_power * detail_power, 1e-30))
    if np.median(_mean(dots * detail, guide, _AROUND_PX) / scale) < _AGREE:
        return None
    covariance = np.max(
        [_mean(np.roll(dots, off, (0, 1)) * detail, guide, _AROUND_PX) for off in _OFF_PX], axis=0
    )
    mean_response = np.maximum(mean_response, 1e-6 * float(mean_response.max()))
    correlation = covariance / scale
    known = correlation > _AGREE
    ambient = (dot_power / np.maximum(covariance, 1e-30) - mean_laser) / mean_response
    typical = max(
        float(np.median(ambient[known])), _DARKEST * float(np.median(mean_laser / mean_response))
    )
    # Bayesian shrinkage to even light: many bright dots give a large weight.
    even = 1 / (mean_laser + typical * mean_response)
    noise = np.maximum(1 - correlation * np.abs(correlation), 0) * detail_power
    dark = (even * _DARK_DN / np.maximum(level, _DARK_DN)) ** 2
    prior = (_VARIES * even) ** 2
    weight = prior * dot_power / ((prior + dark) * dot_power + noise / _DOTS + 1e-30)
    slope = even + weight * (covariance / np.maximum(dot_power, 1e-30) - even)
    estimated = (1 / np.maximum(slope, 1e-30) - mean_laser) / mean_response
    estimated = np.clip(estimated, _LEAST * typical, _MOST * typical)
    share = cv2.medianBlur(np.asarray(estimated / np.median(estimated), np.float32), _SLIVER_PX)
    return np.asarray(share, np.float32)


def _mean(image: NDArray, guide: Image, sigma_px: float) -> Image:
    """Edge-aware mean (domain transform, see `starling.sim.scene.captured.captured_scene`)."""
    image = np.ascontiguousarray(image, np.float32)
    mode = cv2.ximgproc.DTF_NC
    mean = cv2.ximgproc.dtFilter(guide, image, sigma_px, _JUMP_PX, mode=mode)
    return np.asarray(mean, np.float32)
