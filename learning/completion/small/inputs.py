"""Network input computed from a frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import trusted
from starling.learning.completion.frame import CompletionFrame, Image, Mask
from starling.learning.completion.small.proposals import NAMES, proposals

CHANNELS = ("image", "smoothed image", "depth", "valid", "trusted", *NAMES)
_LEVEL = 0.45  # Mean that the image is scaled to.
_DOTS_PX = 2.0  # Sigma of the Gaussian that removes the projector's dots [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SmallInput:
    """Network input. Depth is its natural logarithm, 0 at the frame's median."""

    channels: Image  # (`CHANNELS`, h, w)
    proposed: Image  # (`NAMES`, h, w) logarithms of the proposals.
    sensor: Image  # (h, w) logarithm of the camera's own depth, 0 in holes.
    valid: Mask  # (h, w)
    median_m: float  # Depth that corresponds to 0 [m].


def small_input(frame: CompletionFrame) -> SmallInput:
    """Compute the network input of a frame.

    Depth is divided by its median, so that training on rooms generalises to tables.

    Args:
        frame: frame with some depth.
    """
    median = float(np.median(frame.depth_m[frame.valid]))
    proposed = np.log(proposals(frame) / np.float32(median))
    sensor = np.log(np.where(frame.valid, frame.depth_m, median) / np.float32(median))
    grey = _grey(frame.rgb)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), _DOTS_PX), np.float32)
    flat = [grey, smooth, sensor, frame.valid, trusted(frame)]
    channels = np.concatenate([np.stack(flat).astype(np.float32), proposed])
    return SmallInput(
        channels=channels, proposed=proposed, sensor=sensor, valid=frame.valid, median_m=median
    )


def _grey(rgb: Image) -> NDArray[np.float32]:
    """Return the brightness (h, w), scaled to a common mean."""
    grey = rgb.mean(axis=2)
    gain = _LEVEL / max(float(grey.mean()), 1e-6)
    return np.minimum(grey * np.float32(gain), np.float32(2))
