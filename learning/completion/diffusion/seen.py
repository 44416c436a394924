"""What a network is given of frames: tensors of a size that it can halve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.completion.diffusion.span import Span
from learning.completion.frame import Frame


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Seen:
    """Frames of one size."""

    image: Tensor  # (b, 3, h, w) in -1..1.
    sensor: Tensor  # (b, 1, h, w) depth as `Span` encodes it.
    hole: Tensor  # (b, 1, h, w) 1 where the sensor has no depth, else 0.


def look(frames: Sequence[Frame], *, multiple: int, where: torch.device) -> Seen:
    """Bring frames of one size into tensors; at the bottom and right, edges go on.

    Args:
        frames: with depth in each.
        multiple: of what height and width shall be [px].
        where: the device.
    """
    image = [np.moveaxis(frame.rgb, -1, 0) * 2 - 1 for frame in frames]
    sensor = [Span.of(frame).encoded(frame.depth_m)[None] for frame in frames]
    hole = [~frame.valid[None] for frame in frames]

    def tensor(arrays: Sequence[NDArray]) -> Tensor:
        stack = np.stack([padded(array, multiple) for array in arrays])
        return torch.from_numpy(stack.astype(np.float32)).to(where)

    return Seen(image=tensor(image), sensor=tensor(sensor), hole=tensor(hole))


def padded(channels: NDArray, multiple: int) -> NDArray:
    """Let the edges of (c, h, w) go on at the bottom and right, up to a multiple of pixels."""
    height, width = channels.shape[1:]
    beyond = ((0, 0), (0, -height % multiple), (0, -width % multiple))
    return np.pad(channels, beyond, mode="edge")
