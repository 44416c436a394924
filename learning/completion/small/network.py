"""The network: weights the proposals, corrects their mean, and predicts its error."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from starling.learning.completion.small.inputs import CHANNELS, PROPOSALS
from starling.learning.networks.unet import UNet

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
            proposed: (b, `NAMES`, h, w) logarithms of the proposals.
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
