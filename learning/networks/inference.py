"""Networks on whole images: arrays in, arrays out, as fast as a processor does it plainly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from starling.learning.data.example import Image
from starling.learning.networks.training.learner import device


def apply(network: Callable[[Tensor], Tensor], seen: Image) -> Image:
    """Run a network on one image.

    Channels-last, because the processor's convolutions take 0.7 times as long so. Compiling takes
    off as much again, but two minutes first; 16-bit numbers are slower where the processor has no
    instructions for them.

    Args:
        network: (1, c, h, w) to (1, 1, h, w), its weights on `starling.learning.networks.training.learner.device()`.
        seen: (c, h, w), any size.

    Returns:
        (h, w).
    """
    image = torch.from_numpy(np.ascontiguousarray(seen, np.float32))[None]
    with torch.inference_mode():
        image = image.to(device=device(), memory_format=torch.channels_last)
        return network(image)[0, 0].float().cpu().numpy()
