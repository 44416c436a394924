"""What a network is given of frames: tensors of a size that it can halve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from starling.learning.completion.diffusion.span import Span
from starling.learning.completion.frame import Frame


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Seen:
    """Frames of one size."""

    image: Tensor  # (b, 3, h, w) in -1..1.
    sensor: Tensor  # (b, 1, h, w) depth as `Span` encodes it.
    hole: Tensor  # (b, 1, h, w) 1 where the sensor has no depth, else 0.


def look(frames: Sequence[Frame], *, multiple: int, where: torch.device) -> Seen:
    """Bring frames into tensors of one size; at the bottom and right, edges go on.

    Args:
        frames: with depth in each.
        multiple: of what height and width shall be [px].
        where: the device.
    """
    largest = common([frame.shape for frame in frames])
    image = [np.moveaxis(frame.rgb, -1, 0) * 2 - 1 for frame in frames]
    sensor = [Span.of(frame).encoded(frame.depth_m)[None] for frame in frames]
    hole = [~frame.valid[None] for frame in frames]

    def tensor(arrays: Sequence[NDArray]) -> Tensor:
        stack = np.stack([padded(array, multiple, largest) for array in arrays])
        return torch.from_numpy(stack.astype(np.float32)).to(where)

    return Seen(image=tensor(image), sensor=tensor(sensor), hole=tensor(hole))


def common(shapes: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Height and width in which all find room [px]."""
    return max(height for height, _ in shapes), max(width for _, width in shapes)


def padded(channels: NDArray, multiple: int, least: tuple[int, int] = (1, 1)) -> NDArray:
    """Let the edges of (c, h, w) go on at the bottom and right, up to a multiple of pixels.

    Args:
        channels: any.
        multiple: of what height and width become.
        least: height and width that they have at least.
    """
    sides = [max(pair) for pair in zip(channels.shape[1:], least, strict=True)]
    more = [
        (0, side + -side % multiple - own)
        for side, own in zip(sides, channels.shape[1:], strict=True)
    ]
    return np.pad(channels, ((0, 0), *more), mode="edge")
