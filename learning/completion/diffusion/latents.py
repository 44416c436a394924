"""Images and depth in the autoencoder's latent space.

The autoencoder is that of the image generator, not learnt anew: it keeps depth that is given to
all three channels (Ke et al., CVPR 2024, sec. 3.2).
"""

from __future__ import annotations

from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from torch import Tensor
from torch.nn import functional


def factor(vae: AutoencoderKL) -> int:
    """Pixels along a side of one latent cell; 8 in Stable Diffusion."""
    return 2 ** (len(vae.config["block_out_channels"]) - 1)


def encode(vae: AutoencoderKL, images: Tensor) -> Tensor:
    """Encode images (b, 3, h, w) in -1..1 to (b, 4, h / 8, w / 8).

    The posterior's mode, not a draw, as in Marigold; scaled to about unit variance.
    """
    posterior = vae.encode(images, return_dict=False)[0]
    return posterior.mode() * vae.config["scaling_factor"]


def encode_depth(vae: AutoencoderKL, depth: Tensor) -> Tensor:
    """Encode depth (b, 1, h, w) in -1..1, given to all three channels."""
    return encode(vae, depth.expand(-1, 3, -1, -1))


def decode_depth(vae: AutoencoderKL, latents: Tensor) -> Tensor:
    """Decode latents to depth (b, h, w), the mean of three channels."""
    return vae.decode(latents / vae.config["scaling_factor"], return_dict=False)[0].mean(dim=1)


def cells(mask: Tensor, side: int) -> Tensor:
    """Bring a mask (b, 1, h, w) of 0 and 1 to latent size: 1 where any pixel of the cell is.

    The paper downsamples its mask and does not say how; so no missing pixel is overlooked.
    """
    return functional.max_pool2d(mask, side)
