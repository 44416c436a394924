"""What the network sees of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import trusted
from starling.learning.completion.frame import Frame, Image, Mask
from starling.learning.completion.small.proposals import NAMES, proposals

CHANNELS = ("image", "smoothed image", "depth", "valid", "trusted", *NAMES)
_LEVEL = 0.45  # Mean that the image is exposed to.
_DOTS_PX = 2.0  # Sigma that takes out a projector's dots.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Seen:
    """A frame for the network; depths as natural logarithms, 0 at the frame's median."""

    channels: Image  # (`CHANNELS`, h, w)
    proposed: Image  # (`NAMES`, h, w) logarithms of the proposals.
    given: Image  # (h, w) logarithm of the camera's own depth, 0 in holes.
    valid: Mask  # (h, w)
    median_m: float  # Depth that 0 stands for.


def seen(frame: Frame) -> Seen:
    """Look at a frame.

    Scale is taken out, so that what is learnt of rooms holds for tables.

    Args:
        frame: with depth somewhere.
    """
    median = float(np.median(frame.depth_m[frame.valid]))
    proposed = np.log(proposals(frame) / np.float32(median))
    given = np.log(np.where(frame.valid, frame.depth_m, median) / np.float32(median))
    grey = _grey(frame.rgb)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), _DOTS_PX), np.float32)
    flat = [grey, smooth, given, frame.valid, trusted(frame)]
    channels = np.concatenate([np.stack(flat).astype(np.float32), proposed])
    return Seen(
        channels=channels, proposed=proposed, given=given, valid=frame.valid, median_m=median
    )


def _grey(rgb: Image) -> NDArray[np.float32]:
    """Brightness (h, w), exposed to a mean that images of all kinds are brought to."""
    grey = rgb.mean(axis=2)
    gain = _LEVEL / max(float(grey.mean()), 1e-6)
    return np.minimum(grey * np.float32(gain), np.float32(2))
