"""What a hole's depth may be: continued from each side, from the nearest pixel, and smoothly.

Holes of a stereo camera lie beside what hides them from the other imager, and go on as the surface
on one known side of them. Which side is for the network to say; these are what it chooses from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import trusted
from starling.learning.completion.classical.wls import WeightedLeastSquares
from starling.learning.completion.frame import Frame, Image, Mask
from starling.sim.stereo.filled import filled

NAMES = ("left", "right", "above", "below", "nearest", "smooth")


def proposals(frame: Frame) -> Image:
    """Depths that a frame's pixels may have.

    Args:
        frame: with depth somewhere.

    Returns:
        (`NAMES`, h, w) depth z [m], all known and above zero; where a row or column has no depth,
        or none on that side, the nearest pixel's. At pixels that are trusted, their own.
    """
    known = trusted(frame)
    depth = np.where(known, frame.depth_m, np.float32(0))
    near = filled(depth, known)
    left, right = _carried(depth, near, known)
    above, below = (one.T for one in _carried(depth.T, near.T, known.T))
    smooth = WeightedLeastSquares().fill(frame).depth_m
    return np.stack([left, right, above, below, near, np.where(known, depth, smooth)])


def _carried(depth: Image, near: Image, known: Mask) -> tuple[Image, Image]:
    """Depth of the last known pixel before each in its row, and of the first after it."""
    columns = np.arange(known.shape[1])
    before = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, columns, known.shape[1])[:, ::-1], axis=1)[
        :, ::-1
    ]
    return _taken(depth, near, before, before >= 0), _taken(
        depth, near, after, after < known.shape[1]
    )


def _taken(depth: Image, near: Image, where: NDArray[np.intp], there: Mask) -> Image:
    columns = np.clip(where, 0, depth.shape[1] - 1)
    return np.where(there, np.take_along_axis(depth, columns, axis=1), near)
