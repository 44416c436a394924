"""Waves: a smooth random shift of the image that each unit is born with.

Rectification leaves a shift of each pixel's column that no lens model explains. It is static, and
of each unit its own. The field is normal noise on an even grid of angles, smoothed by a Gaussian.
Its correlation falls to 1/e over the length L: r(a) = exp(-(a / L)^2), across and down. The grid
starts at the principal point, so every mode of a camera shows a part of the same field. In a view
of 70 x 44 degrees the field has mean 0, as factories calibrate, and the size asked for. There the
two imagers' fields are uncorrelated, so that disparity errors of all units are nearly equally
large. How sizes differ between units is unknown.

Source: disparity errors of a D415 in ten rooms (docs/results/matcher.md).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die, Side
from starling.sim.sensor.imager import SHORTEST_WAVE_DEG, Alignment

_PER_LENGTH = 2  # Grid points in a length.
_REACH = 4.0  # Range of the Gaussian [grid steps]; its sigma is one step.
_VIEW_DEG = (22, 35)  # Half the view, down and across, that the size holds in: a D415's.
_HALF = int(90 / SHORTEST_WAVE_DEG) * _PER_LENGTH  # Grid points from the axis to a right angle.


def field(alignment: Alignment, pinhole: Pinhole, die: Die) -> Image:
    """Return the shift of every pixel to the right (h, w) [px].

    Args:
        alignment: supplies size and lengths of the waves.
        pinhole: intrinsics of the image.
        die: unit and side, which select the draw.
    """
    if alignment.waves_px == 0:
        return np.zeros((pinhole.height, pinhole.width), np.float32)
    lengths_deg = (alignment.waves_across_deg, alignment.waves_down_deg)
    return _field(alignment.waves_px, lengths_deg, pinhole, die)


@lru_cache(maxsize=4)  # Both imagers, two image sizes.
def _field(size_px: float, lengths_deg: tuple[float, float], pinhole: Pinhole, die: Die) -> Image:
    across, down = (
        (np.arange(count) - centre) / focal
        for count, centre, focal in (
            (pinhole.width, pinhole.cx_px, pinhole.fx_px),
            (pinhole.height, pinhole.cy_px, pinhole.fy_px),
        )
    )

    view_down, view_across = (np.tan(np.radians(np.arange(-half, half + 1))) for half in _VIEW_DEG)

    def drawn(side: Side) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw one imager's field: image, and view without its mean."""
        nodes = Die(die.unit, side).normal("waves", (2 * _HALF + 1, 2 * _HALF + 1))
        view, image = (
            _weights(rows, lengths_deg[1]) @ nodes @ _weights(columns, lengths_deg[0]).T
            for rows, columns in ((view_down, view_across), (down, across))
        )
        return image - view.mean(), view - view.mean()

    image, view = drawn(die.side)
    if die.side == "right":
        left_image, left_view = drawn("left")
        common = (view * left_view).mean() / left_view.var()
        image, view = image - common * left_image, view - common * left_view
    shift = (image * (size_px / view.std())).astype(np.float32)
    shift.setflags(write=False)  # All captures share the array.
    return shift


def _weights(tangent: NDArray[np.floating], length_deg: float) -> NDArray[np.float64]:
    """Return the weights (pixels, grid points) of the smoothing along one axis."""
    step_deg = length_deg / _PER_LENGTH
    place = np.degrees(np.arctan(tangent))[:, None] / step_deg
    off = place - np.arange(-_HALF, _HALF + 1)
    weights = np.where(np.abs(off) <= _REACH, np.exp(-(off**2) / 2), 0.0)
    return weights / np.sqrt((weights**2).sum(axis=1, keepdims=True))
