"""Networks on their device: placement, precision and inference."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from starling.learning.data.example import Image

_Network = TypeVar("_Network", bound=nn.Module)


def device() -> torch.device:
    """Return the GPU if there is one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def mixed_precision(target: torch.device) -> torch.autocast:
    """Use 16-bit arithmetic on a GPU, which is sufficient for training; no effect elsewhere."""
    return torch.autocast(target.type, torch.bfloat16, enabled=target.type == "cuda")


def initialised(build: Callable[[], _Network], seed: int) -> _Network:
    """Build a network with initial weights from a seed, without changing torch's random state."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return to_device(build())


def to_device(network: _Network) -> _Network:
    """Move a network to its device, in the memory layout that is fast for convolutions."""
    network = network.to(device())
    return nn.utils.convert_conv2d_weight_memory_format(network, torch.channels_last)


def run_network(network: Callable[[Tensor], Tensor], inputs: Image) -> Image:
    """Run a network on one image.

    Channels-last layout takes 0.7 of the time on a processor. Compilation would save as much again
    but takes two minutes. 16-bit numbers are slower on processors without such instructions.

    Args:
        network: (1, c, h, w) to (1, 1, h, w), with its weights on
            `device()`.
        inputs: (c, h, w), any size.

    Returns:
        (h, w).
    """
    image = torch.from_numpy(np.ascontiguousarray(inputs, np.float32))[None]
    with torch.inference_mode():
        image = image.to(device=device(), memory_format=torch.channels_last)
        return network(image)[0, 0].float().cpu().numpy()
