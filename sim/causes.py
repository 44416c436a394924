"""Causes of missing depth that follow from the scene's geometry and from the amount of light.

The matcher reports its own causes. `sim.reason.first_cause` ranks all of them.
"""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image, Mask
from starling.sim.imaging import imager
from starling.sim.reason import Reason
from starling.sim.render.layers import Truth
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.depth import disparity_from_depth

WINDOW_PX = 9  # Side of the window that is tested for light [px].
DARK_SNR = 2.0  # A window below this mean signal over noise is LOW_SIGNAL.
BURNT_SHARE = 0.25  # A window with a larger share of full pixels is SATURATED.
FIRST_COLUMN_PX = -0.5  # Left edge of the right image: matches beyond it are OUTSIDE_OVERLAP.


def geometric_causes(truth: Truth, sensor: Sensor) -> dict[Reason, Mask]:
    """Return masks (h, w) of no surface, projector shadow, outside the overlap and occlusion."""
    surface = np.isfinite(truth.depth_m)
    causes = {
        Reason.NO_SURFACE: ~surface,
        Reason.SHADOWED: surface & ~truth.lit & (sensor.projector.power_w > 0),
    }
    if sensor.kind == "structured_light":  # No right imager, so no occlusion.
        return causes
    disparity = disparity_from_depth(
        truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.true_baseline_m
    )
    match_px = np.arange(sensor.width, dtype=np.float32) - disparity
    outside = surface & (match_px < FIRST_COLUMN_PX)
    causes[Reason.OUTSIDE_OVERLAP] = outside
    causes[Reason.OCCLUDED] = surface & ~truth.right_sees & ~outside
    return causes


def photometric_causes(
    device: Imager, electrons: Image, infrared: imager.Infrared, *, exposure_s: float
) -> dict[Reason, Mask]:
    """Return masks (h, w) of too little signal and of saturation.

    Args:
        device: Left imager.
        electrons: (h, w) expected electrons of each pixel, before noise.
        infrared: (h, w) image that the imager delivers [DN].
        exposure_s: Exposure time [s], for dark current.
    """
    window = (WINDOW_PX, WINDOW_PX)
    mean = np.asarray(cv2.blur(electrons, window), np.float32)
    step_e = 1 / device.dn_per_electron
    noise_e = imager.noise_e(device, mean, exposure_s)
    noise = np.sqrt(noise_e**2 + np.float32(step_e * step_e / 12))
    burnt = (infrared >= device.saturation_dn).astype(np.float32)
    return {
        Reason.LOW_SIGNAL: mean < DARK_SNR * noise,
        Reason.SATURATED: cv2.blur(burnt, window) > BURNT_SHARE,
    }
