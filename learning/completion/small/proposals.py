"""Proposals of depth in holes: extended from each side, from the nearest pixel, and smooth.

Holes of a stereo camera lie next to the object that hides them from the other imager, and continue
the surface on one known side. The network weights these proposals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import trusted
from starling.learning.completion.classical.wls import WeightedLeastSquares
from starling.learning.completion.frame import CompletionFrame, Image, Mask
from starling.sim.arrays import filled

NAMES = ("left", "right", "above", "below", "nearest", "smooth")


def proposals(frame: CompletionFrame) -> Image:
    """Propose depths of a frame's pixels.

    Args:
        frame: frame with some depth.

    Returns:
        (`NAMES`, h, w) depth z [m], all finite and above zero. Where a row or column has no depth
        on that side, the nearest pixel's depth replaces it. Trusted pixels keep their depth.
    """
    known = trusted(frame)
    depth = np.where(known, frame.depth_m, np.float32(0))
    near = filled(depth, known)
    left, right = _carried(depth, near, known)
    above, below = (image.T for image in _carried(depth.T, near.T, known.T))
    smooth = WeightedLeastSquares().fill(frame).depth_m
    return np.stack([left, right, above, below, near, np.where(known, depth, smooth)])


def _carried(depth: Image, near: Image, known: Mask) -> tuple[Image, Image]:
    """Return the depth of the last known pixel before each pixel of a row, and of the next one."""
    columns = np.arange(known.shape[1])
    before = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, columns, known.shape[1])[:, ::-1], axis=1)[
        :, ::-1
    ]
    return _taken(depth, near, before, before >= 0), _taken(
        depth, near, after, after < known.shape[1]
    )


def _taken(depth: Image, near: Image, where: NDArray[np.intp], exists: Mask) -> Image:
    columns = np.clip(where, 0, depth.shape[1] - 1)
    return np.where(exists, np.take_along_axis(depth, columns, axis=1), near)
