"""How ambient light varies over a captured room, told place by place by the projector's dots.

Lamps hang above, windows are to one side, and shadows fall. In a neighbourhood on one surface an
image is r (P + E a): of reflectance r, the projector's light P, which is known where the sensor's
pattern is the camera's own, and ambient light E on surfaces that return a of it. Brightness does
not part r from E. But over its own mean the image follows P by 1 / (P + E a), in the mean, whatever
r is. Whatever else weakens dots or strengthens them at one place, as a highlight does, passes for
light too.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.imaging.signals import Signals
from starling.sim.scene.captured import depth_mesh
from starling.sim.stereo.filled import filled

Array = NDArray[np.float32]

_LEVEL_PX = 12.0  # Sigma of the mean that an image is taken over: some dots of a D415 wide;
_AROUND_PX = 24.0  # of the neighbourhood in which it follows the dots,
_DOTS = 100.0  # of which there are about as many.
_JUMP_PX = 2.0  # Steps of disparity far above it part surfaces.
# Where dots may lie off their place (rows, columns), by errors of depth.
_OFF_PX = tuple((y, x) for y in (-1, 0, 1) for x in (-2, -1, 0, 1, 2))
_SLIVER_PX = 5  # Side of a median that takes out what has too few pixels to tell anything.
_AGREE = 0.3  # Least correlation with the dots, in the middle: 0.7 where the pattern is known.
_VARIES = 0.7  # Deviation of what follows the dots from that in even light, as a share of it.
_DARK_DN = 1.0  # Black level and veil are known to about so much.
_DARKEST = 1e-3  # Of the projector's: with less ambient light its share is of no account.
_LEAST, _MOST = 0.1, 10.0  # Of the middle: beyond them dots tell nothing.


def told(dotted: Array, light: Signals, disparity_px: Array) -> Array | None:
    """Ambient light over its median.

    Args:
        dotted: (h, w) image with dots [DN above black].
        light: on surfaces of one reflectance, as the image's imager sees it in the mean.
        disparity_px: (h, w) reference, NaN where unknown; known somewhere.

    Returns:
        (h, w), nearly 1 where few dots fall; None where the image's dots are not those of the
        light.
    """
    if not light.laser.any():
        return None
    surface_px = depth_mesh.smoothed(depth_mesh.closed(disparity_px))
    guide = np.ascontiguousarray(filled(surface_px, np.isfinite(surface_px)), np.float32)
    laser = np.asarray(light.laser / np.mean(light.laser), np.float32)
    ambient = np.asarray(light.ambient / np.mean(light.laser), np.float32)
    level = _mean(dotted, guide, _LEVEL_PX)
    over = np.asarray(dotted / np.maximum(level, 1e-3 * float(dotted.mean()) + 1e-6), np.float32)
    dots, follows = laser - _mean(laser, guide, _LEVEL_PX), over - _mean(over, guide, _LEVEL_PX)
    of_dots, of_image, thrown, other = (
        _mean(one, guide, _AROUND_PX) for one in (dots * dots, follows * follows, laser, ambient)
    )
    both = np.sqrt(np.maximum(of_dots * of_image, 1e-30))
    if np.median(_mean(dots * follows, guide, _AROUND_PX) / both) < _AGREE:
        return None
    common = np.max(
        [_mean(np.roll(dots, off, (0, 1)) * follows, guide, _AROUND_PX) for off in _OFF_PX], axis=0
    )
    other = np.maximum(other, 1e-6 * float(other.max()))
    agree = common / both
    known = agree > _AGREE
    lit = (of_dots / np.maximum(common, 1e-30) - thrown) / other
    middle = max(float(np.median(lit[known])), _DARKEST * float(np.median(thrown / other)))
    # Bayes: it is believed as far as dots are many and bright.
    even = 1 / (thrown + middle * other)
    rest = np.maximum(1 - agree * np.abs(agree), 0) * of_image
    dark = (even * _DARK_DN / np.maximum(level, _DARK_DN)) ** 2
    prior = (_VARIES * even) ** 2
    believed = prior * of_dots / ((prior + dark) * of_dots + rest / _DOTS + 1e-30)
    slope = even + believed * (common / np.maximum(of_dots, 1e-30) - even)
    found = (1 / np.maximum(slope, 1e-30) - thrown) / other
    found = np.clip(found, _LEAST * middle, _MOST * middle)
    share = cv2.medianBlur(np.asarray(found / np.median(found), np.float32), _SLIVER_PX)
    return np.asarray(share, np.float32)


def _mean(image: NDArray, guide: Array, sigma_px: float) -> Array:
    """Mean around each pixel on its surface (domain transform, see `starling.sim.scene.captured.edge_unmixing`)."""
    image = np.ascontiguousarray(image, np.float32)
    mode = cv2.ximgproc.DTF_NC
    mean = cv2.ximgproc.dtFilter(guide, image, sigma_px, _JUMP_PX, mode=mode)
    return np.asarray(mean, np.float32)
