"""The compact network and its input: image, depth, and proposals of depth in holes.

Holes of a stereo camera lie next to the object that hides them from the other imager, and continue
the surface on one known side. Proposals are extended from each side, from the nearest pixel, and
smooth. The network weights them, corrects their mean, and predicts its error.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from starling.learning.completion.classical import completed, trusted, wls
from starling.learning.completion.method import CompletionFrame, Image, Mask
from starling.learning.networks.unet import UNet
from starling.sim.arrays import filled

PROPOSALS = ("left", "right", "above", "below", "nearest", "smooth")


def proposals(frame: CompletionFrame) -> Image:
    """Propose depths of a frame's pixels.

    Args:
        frame: frame with some depth.

    Returns:
        (`PROPOSALS`, h, w) depth z [m], all finite and above zero. Where a row or column has no
        depth on that side, the nearest pixel's depth replaces it. Trusted pixels keep their depth.
    """
    known = trusted(frame)
    depth = np.where(known, frame.depth_m, np.float32(0))
    near = filled(depth, known)
    left, right = _carried(depth, near, known)
    above, below = (image.T for image in _carried(depth.T, near.T, known.T))
    smooth = completed(frame, wls(frame)).depth_m
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


CHANNELS = ("image", "smoothed image", "depth", "valid", "trusted", *PROPOSALS)
_LEVEL = 0.45  # Mean that the image is scaled to.
_DOTS_PX = 2.0  # Sigma of the Gaussian that removes the projector's dots [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SmallInput:
    """Network input. Depth is its natural logarithm, 0 at the frame's median."""

    channels: Image  # (`CHANNELS`, h, w)
    proposed: Image  # (`PROPOSALS`, h, w) logarithms of the proposals.
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


WIDTHS = (24, 32, 48, 64, 64)
_SCALE = (-7.0, 1.5)  # Range of ln(b): errors from 0.1 % to a factor of 4.
_REACH = 0.7  # Greatest correction of the logarithm, a bound for frames unlike the training data.


@dataclass(frozen=True, slots=True, eq=False)
class SmallOutput:
    """Output of the network; each (b, 1, h, w)."""

    log_depth: Tensor  # Natural logarithm of depth, 0 at the frame's median.
    log_scale: Tensor  # ln b of the Laplace distribution of `log_depth`.
    false: Tensor  # Logit that the camera's own depth is false.


class SmallNetwork(nn.Module):
    """A U-Net. Untrained, it returns the mean of the proposals and trusts the camera's depth."""

    def __init__(self) -> None:
        super().__init__()
        self.body = UNet(len(CHANNELS), len(PROPOSALS) + 3, WIDTHS)

    def forward(self, channels: Tensor, proposed: Tensor) -> SmallOutput:
        """Complete frames.

        Args:
            channels: (b, `CHANNELS`, h, w).
            proposed: (b, `PROPOSALS`, h, w) logarithms of the proposals.
        """
        out = self.body(channels).float()
        weights = functional.softmax(out[:, : len(PROPOSALS)], dim=1)
        correction, scale, false = out[:, len(PROPOSALS) :].split(1, dim=1)
        low, high = _SCALE
        return SmallOutput(
            log_depth=(weights * proposed).sum(dim=1, keepdim=True)
            + _REACH * torch.tanh(correction / _REACH),
            log_scale=(scale - 3).clamp(low, high),
            false=false - 4,
        )


def final_log_depth(output: SmallOutput, sensor: Tensor, valid: Tensor) -> Tensor:
    """Return the final logarithm of depth: the camera's own unless it is probably false.

    Args:
        output: output of the network.
        sensor: (b, 1, h, w) logarithm of the camera's depth.
        valid: (b, 1, h, w) 1 where the camera has depth.
    """
    trusted = (valid > 0) & (output.false < 0)
    return torch.where(trusted, sensor, output.log_depth)
