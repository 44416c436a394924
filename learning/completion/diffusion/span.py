"""Frames as network inputs: encoding of metric depth, and the autoencoder's latents.

The autoencoder of the image generator stays fixed. It reproduces depth that is repeated in all
three channels (Ke et al., CVPR 2024, sec. 3.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from starling.learning.completion.alignment import Normalisation, normalisation
from starling.learning.completion.method import CompletionFrame, Image

HOLE = -1.0  # Encoded value of a pixel without depth; the paper does not state its value.
# The sensor's span maps to -0.8..0.8, because depth in holes often lies outside this span.
_INNER = 0.8


@dataclass(frozen=True, slots=True)
class Span:
    """Range of a frame's sensor depth, which fixes scale and shift of the encoding.

    Truth and prediction are encoded by the sensor's span, so that a prediction decodes to metres
    without ground truth (the paper's "sensor depth scale", sec. 4.3).
    """

    normalisation: Normalisation

    @classmethod
    def from_frame(cls, frame: CompletionFrame) -> Span:
        """Estimate the span of a frame that has some depth."""
        return cls(normalisation(frame.depth_m, frame.valid))

    def encode(self, depth_m: Image) -> Image:
        """Encode depth [m] of any shape to -1..1; NaN becomes `HOLE`."""
        values = np.clip(_INNER * self.normalisation(depth_m), -1, 1)
        return np.where(np.isnan(depth_m), np.float32(HOLE), values)

    def decode(self, encoded: NDArray[Any]) -> Image:
        """Decode to depth [m]; NaN where the result is not above zero."""
        depth = self.normalisation.denormalise(encoded / _INNER)
        return np.where(depth > 0, depth, np.float32(np.nan))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NetworkInput:
    """Frames of one size as network input."""

    image: Tensor  # (b, 3, h, w) in -1..1.
    sensor: Tensor  # (b, 1, h, w) the sensor's depth as `Span` encodes it.
    hole: Tensor  # (b, 1, h, w) 1 where the sensor has no depth, else 0.


def network_input(
    frames: Sequence[CompletionFrame], *, multiple: int, device: torch.device
) -> NetworkInput:
    """Convert frames to tensors of one size, padded at the bottom and right by their edge pixels.

    Args:
        frames: frames, each with some depth.
        multiple: height and width become multiples of this number [px].
        device: the device.
    """
    largest = common_size([frame.shape for frame in frames])
    image = [np.moveaxis(frame.rgb, -1, 0) * 2 - 1 for frame in frames]
    sensor = [Span.from_frame(frame).encode(frame.depth_m)[None] for frame in frames]
    hole = [~frame.valid[None] for frame in frames]

    def tensor(arrays: Sequence[NDArray]) -> Tensor:
        stack = np.stack([pad_edges(array, multiple, largest) for array in arrays])
        return torch.from_numpy(stack.astype(np.float32)).to(device)

    return NetworkInput(image=tensor(image), sensor=tensor(sensor), hole=tensor(hole))


def common_size(shapes: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the least height and width [px] that hold all shapes."""
    return max(height for height, _ in shapes), max(width for _, width in shapes)


def pad_edges(channels: NDArray, multiple: int, least: tuple[int, int] = (1, 1)) -> NDArray:
    """Pad (c, h, w) at the bottom and right by its edge pixels, to a multiple of pixels.

    Args:
        channels: the image.
        multiple: height and width become multiples of this number [px].
        least: least height and width [px].
    """
    sides = [max(pair) for pair in zip(channels.shape[1:], least, strict=True)]
    padding = [
        (0, side + -side % multiple - length)
        for side, length in zip(sides, channels.shape[1:], strict=True)
    ]
    return np.pad(channels, ((0, 0), *padding), mode="edge")


def factor(vae: AutoencoderKL) -> int:
    """Return the side of one latent cell [px]; 8 in Stable Diffusion."""
    return 2 ** (len(vae.config["block_out_channels"]) - 1)


def encode(vae: AutoencoderKL, images: Tensor) -> Tensor:
    """Encode images (b, 3, h, w) in -1..1 to latents (b, 4, h / 8, w / 8).

    Returns the posterior's mode, as Marigold does, scaled to about unit variance.
    """
    posterior = vae.encode(images, return_dict=False)[0]
    return posterior.mode() * vae.config["scaling_factor"]


def encode_depth(vae: AutoencoderKL, depth: Tensor) -> Tensor:
    """Encode depth (b, 1, h, w) in -1..1, repeated in all three channels."""
    return encode(vae, depth.expand(-1, 3, -1, -1))


def decode_depth(vae: AutoencoderKL, latents: Tensor) -> Tensor:
    """Decode latents to depth (b, h, w), the mean of three channels."""
    return vae.decode(latents / vae.config["scaling_factor"], return_dict=False)[0].mean(dim=1)


def cells(mask: Tensor, side: int) -> Tensor:
    """Downsample a mask (b, 1, h, w) of 0 and 1 to latent size by the maximum of each cell.

    The paper does not state how it downsamples its mask. The maximum misses no hole.
    """
    return functional.max_pool2d(mask, side)
