"""Inference of networks on whole images."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from starling.learning.data.example import Image
from starling.learning.networks.training.learner import device


def apply(network: Callable[[Tensor], Tensor], inputs: Image) -> Image:
    """Run a network on one image.

    Channels-last layout takes 0.7 of the time on a processor. Compilation would save as much again
    but takes two minutes. 16-bit numbers are slower on processors without such instructions.

    Args:
        network: (1, c, h, w) to (1, 1, h, w), with its weights on
            `starling.learning.networks.training.learner.device()`.
        inputs: (c, h, w), any size.

    Returns:
        (h, w).
    """
    image = torch.from_numpy(np.ascontiguousarray(inputs, np.float32))[None]
    with torch.inference_mode():
        image = image.to(device=device(), memory_format=torch.channels_last)
        return network(image)[0, 0].float().cpu().numpy()
