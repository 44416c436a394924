"""Images and depth in the autoencoder's latent space.

The autoencoder of the image generator stays fixed. It reproduces depth that is repeated in all
three channels (Ke et al., CVPR 2024, sec. 3.2).
"""

from __future__ import annotations

from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from torch import Tensor
from torch.nn import functional


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
