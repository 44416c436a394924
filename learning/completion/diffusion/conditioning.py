"""How the denoising network is told image and sensor depth: the paper's three ways."""

from __future__ import annotations

from itertools import chain
from typing import Any, Protocol

import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.controlnets.controlnet import ControlNetModel
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from torch import Tensor, nn

from starling.learning.completion.diffusion import latents
from starling.learning.completion.diffusion.seen import Seen
from starling.learning.completion.diffusion.unet import widen
from starling.learning.completion.diffusion.variants import VARIANTS, Variant
from starling.learning.completion.diffusion.weights import Weights
from starling.patterns.errors import one_of, refuse

_LATENTS = 3  # Of image, sensor depth and noisy depth.
_EMBEDDING = (16, 32, 96, 256)  # Widths of ControlNet's encoder, each half the size of the last.


class Conditioning(Protocol):
    """A denoising network and what it is told."""

    @property
    def variant(self) -> Variant:
        """Which of the three."""
        ...

    @property
    def networks(self) -> nn.ModuleDict:
        """All of them."""
        ...

    def condition(self, seen: Seen, vae: AutoencoderKL) -> Tensor:
        """What is told of frames, the same at all steps."""
        ...

    def noise(self, noisy: Tensor, step: Tensor, condition: Tensor, text: Tensor) -> Tensor:
        """Tell the noise in latents.

        Args:
            noisy: (b, 4, h, w).
            step: (b,) of the noise schedule.
            condition: as `condition` gives.
            text: (b, n, d).
        """
        ...


class Concatenated:
    """Latents side by side: image, sensor depth, noisy depth [, mask of holes]."""

    def __init__(self, unet: UNet2DConditionModel) -> None:
        self.networks = nn.ModuleDict({"unet": unet})
        self._unet = unet
        self._masked = unet.config["in_channels"] % _LATENTS == 1

    @property
    def variant(self) -> Variant:
        return "rgbd-mask" if self._masked else "rgbd"

    def condition(self, seen: Seen, vae: AutoencoderKL) -> Tensor:
        parts = [latents.encode(vae, seen.image), latents.encode_depth(vae, seen.sensor)]
        if self._masked:
            parts.append(latents.cells(seen.hole, latents.factor(vae)))
        return torch.cat(parts, dim=1)

    def noise(self, noisy: Tensor, step: Tensor, condition: Tensor, text: Tensor) -> Tensor:
        encoded = (_LATENTS - 1) * noisy.shape[1]
        told = torch.cat([condition[:, :encoded], noisy, condition[:, encoded:]], dim=1)
        return self._unet(told, step, encoder_hidden_states=text, return_dict=False)[0]


class Controlled:
    """ControlNet, whose own encoder sees image and sensor depth (Zhang et al., ICCV 2023)."""

    variant: Variant = "controlnet"

    def __init__(self, unet: UNet2DConditionModel, controlnet: ControlNetModel) -> None:
        self.networks = nn.ModuleDict({"unet": unet, "controlnet": controlnet})
        self._unet, self._controlnet = unet, controlnet

    def condition(self, seen: Seen, vae: AutoencoderKL) -> Tensor:
        del vae  # Its encoder is learnt, and sees pixels.
        return torch.cat([seen.image, seen.sensor], dim=1)

    def noise(self, noisy: Tensor, step: Tensor, condition: Tensor, text: Tensor) -> Tensor:
        down, middle = self._controlnet(
            noisy,
            step,
            encoder_hidden_states=text,
            controlnet_cond=condition,
            return_dict=False,
        )
        return self._unet(
            noisy,
            step,
            encoder_hidden_states=text,
            down_block_additional_residuals=down,
            mid_block_additional_residual=middle,
            return_dict=False,
        )[0]


def begin(weights: Weights, variant: Variant, *, seed: int) -> Conditioning:
    """Make a conditioning of an image generator's weights, ready to be learnt.

    All is learnt that the paper learns: everything where latents are side by side; with ControlNet
    the decoder and ControlNet itself, while the encoder, down to the middle, of which ControlNet
    has a copy, is fixed.

    Args:
        weights: of a text-to-image model; its network is changed.
        variant: which.
        seed: of what ControlNet's own encoder begins with.

    Raises:
        InputError: if the variant is not known, or the weights take other than bare latents.
    """
    one_of("variant", variant, VARIANTS)
    unet, bare = weights.unet, weights.vae.config["latent_channels"]
    if unet.config["in_channels"] != bare or weights.controlnet:
        rule = f"must be of a text-to-image model, with {bare} channels in, to learn from"
        got = f"{unet.config['in_channels']}" + (" and controlnet/" if weights.controlnet else "")
        raise refuse("weights", rule, got, "Give what was published, not what was learnt here.")
    if variant == "controlnet":
        levels = len(weights.vae.config["block_out_channels"])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            controlnet = ControlNetModel.from_unet(
                unet,
                conditioning_channels=4,
                conditioning_embedding_out_channels=_EMBEDDING[:levels],
            )
        decoder: tuple[Any, ...] = (unet.up_blocks, unet.conv_norm_out, unet.conv_out)
        for part in (*decoder, controlnet):
            part.requires_grad_(True)
        return Controlled(unet, controlnet)
    widen(unet, copies=_LATENTS, further=1 if variant == "rgbd-mask" else 0)
    unet.requires_grad_(True)
    return Concatenated(unet)


def learnt(weights: Weights) -> Conditioning:
    """Find the conditioning that weights were trained for.

    Raises:
        InputError: if they were not trained for completion.
    """
    if weights.controlnet is not None:
        return Controlled(weights.unet, weights.controlnet)
    wide = _LATENTS * weights.vae.config["latent_channels"]
    if (inputs := weights.unet.config["in_channels"]) not in (wide, wide + 1):
        rule = f"must be trained for completion, with {wide} or {wide + 1} channels in"
        raise refuse("weights", rule, inputs, "Train first, from these weights.")
    return Concatenated(weights.unet)


def trainable(conditioning: Conditioning) -> list[nn.Parameter]:
    """What of its networks is learnt."""
    parameters = chain.from_iterable(part.parameters() for part in conditioning.networks.values())
    return [parameter for parameter in parameters if parameter.requires_grad]
