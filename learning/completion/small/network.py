"""The network: weighs the proposals, corrects what they give, and says how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from starling.learning.completion.small.proposals import NAMES
from starling.learning.completion.small.seen import CHANNELS
from starling.learning.networks.unet import UNet

WIDTHS = (24, 32, 48, 64, 64)
_SCALE = (-7.0, 1.5)  # Of ln(b): errors from 0.1 % to a factor of 4.
_REACH = 0.7  # Largest correction of a logarithm: in frames unlike all that was learnt from, too.


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What the network says; each (b, 1, h, w)."""

    log_depth: Tensor  # Natural logarithm of depth, 0 at the frame's median.
    log_scale: Tensor  # ln b of a Laplace distribution about it.
    false: Tensor  # Logit that the camera's own depth is wrong.


class SmallNetwork(nn.Module):
    """A U-Net; before it has learnt it gives the mean of the proposals, and trusts the camera."""

    def __init__(self) -> None:
        super().__init__()
        self.body = UNet(len(CHANNELS), len(NAMES) + 3, WIDTHS)

    def forward(self, channels: Tensor, proposed: Tensor) -> Told:
        """Complete frames.

        Args:
            channels: (b, `CHANNELS`, h, w).
            proposed: (b, `NAMES`, h, w) logarithms.
        """
        out = self.body(channels).float()
        weights = functional.softmax(out[:, : len(NAMES)], dim=1)
        correction, scale, false = out[:, len(NAMES) :].split(1, dim=1)
        low, high = _SCALE
        return Told(
            log_depth=(weights * proposed).sum(dim=1, keepdim=True)
            + _REACH * torch.tanh(correction / _REACH),
            log_scale=(scale - 3).clamp(low, high),
            false=false - 4,
        )


def kept(told: Told, given: Tensor, valid: Tensor) -> Tensor:
    """Logarithm of depth in the end: the camera's own unless it is more likely false than not.

    Args:
        told: by the network.
        given: (b, 1, h, w) logarithm of the camera's depth.
        valid: (b, 1, h, w) 1 where it has some.
    """
    own = (valid > 0) & (told.false < 0)
    return torch.where(own, given, told.log_depth)
