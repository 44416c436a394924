"""A pretrained network made to take more latents than it has learnt on."""

from __future__ import annotations

from typing import Any

import torch
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from torch import nn


def widen(network: UNet2DConditionModel, *, copies: int, further: int) -> None:
    """Let the first layer take several latents at once, and further channels.

    Its weights are given to each latent and divided by their number, so that what comes out has the
    size that the other layers know (the paper's sec. 3): of equal latents, it is the same as
    before. Further channels, of which nothing has been learnt, begin at zero and so change nothing
    at first.

    Args:
        network: is changed, with its configuration.
        copies: latents that it takes.
        further: channels after them.
    """
    old: Any = network.conv_in
    inputs = copies * old.in_channels + further
    new = nn.Conv2d(inputs, old.out_channels, old.kernel_size, padding=old.padding)
    with torch.no_grad():
        new.weight[:, : inputs - further] = old.weight.repeat(1, copies, 1, 1) / copies
        new.weight[:, inputs - further :] = 0
        new.get_parameter("bias").copy_(old.bias)
    network.conv_in = new.to(old.weight.device, old.weight.dtype)
    network.register_to_config(in_channels=inputs)
