"""The three ways of the paper to condition the denoising network on image and sensor depth."""

from __future__ import annotations

from itertools import chain
from typing import Any, Protocol

import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.controlnets.controlnet import ControlNetModel
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from torch import Tensor, nn

from starling.learning.completion.diffusion import VARIANTS, Variant, span
from starling.learning.completion.diffusion.span import NetworkInput
from starling.learning.completion.diffusion.weights import Weights
from starling.patterns.errors import one_of, refuse

_LATENTS = 3  # Latents that are concatenated: image, sensor depth, noisy depth.
_EMBEDDING = (16, 32, 96, 256)  # Channels of ControlNet's image encoder, level by level.


class Conditioning(Protocol):
    """A denoising network with its conditioning on a frame."""

    @property
    def variant(self) -> Variant:
        """Name of the conditioning."""
        ...

    @property
    def networks(self) -> nn.ModuleDict:
        """All networks, by name."""
        ...

    def condition(self, inputs: NetworkInput, vae: AutoencoderKL) -> Tensor:
        """Encode the frames. The result is the same for all denoising steps."""
        ...

    def noise(self, noisy: Tensor, step: Tensor, condition: Tensor, text: Tensor) -> Tensor:
        """Predict the noise in latents.

        Args:
            noisy: noisy latents (b, 4, h, w).
            step: step (b,) of the noise schedule.
            condition: result of `condition`.
            text: encoded prompt (b, n, d).
        """
        ...


class Concatenated:
    """Concatenates the latents of image, sensor depth and noisy depth [, and the hole mask]."""

    def __init__(self, unet: UNet2DConditionModel) -> None:
        self.networks = nn.ModuleDict({"unet": unet})
        self._unet = unet
        self._masked = unet.config["in_channels"] % _LATENTS == 1

    @property
    def variant(self) -> Variant:
        return "rgbd-mask" if self._masked else "rgbd"

    def condition(self, inputs: NetworkInput, vae: AutoencoderKL) -> Tensor:
        encoded_inputs = [
            span.encode(vae, inputs.image),
            span.encode_depth(vae, inputs.sensor),
        ]
        if self._masked:
            encoded_inputs.append(span.cells(inputs.hole, span.factor(vae)))
        return torch.cat(encoded_inputs, dim=1)

    def noise(self, noisy: Tensor, step: Tensor, condition: Tensor, text: Tensor) -> Tensor:
        encoded = (_LATENTS - 1) * noisy.shape[1]
        stacked = torch.cat([condition[:, :encoded], noisy, condition[:, encoded:]], dim=1)
        return self._unet(stacked, step, encoder_hidden_states=text, return_dict=False)[0]


class Controlled:
    """ControlNet with an encoder for image and sensor depth (Zhang et al., ICCV 2023)."""

    variant: Variant = "controlnet"

    def __init__(self, unet: UNet2DConditionModel, controlnet: ControlNetModel) -> None:
        self.networks = nn.ModuleDict({"unet": unet, "controlnet": controlnet})
        self._unet, self._controlnet = unet, controlnet

    def condition(self, inputs: NetworkInput, vae: AutoencoderKL) -> Tensor:
        del vae  # The encoder is trained and takes pixels.
        return torch.cat([inputs.image, inputs.sensor], dim=1)

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


def adapt_generator(weights: Weights, variant: Variant, *, seed: int) -> Conditioning:
    """Adapt the weights of an image generator for conditioning, ready for training.

    With concatenated latents, all weights are trained. With ControlNet, its encoder and the
    generator's decoder are trained. The generator's encoder and middle block stay fixed, because
    ControlNet trains a copy of them.

    Args:
        weights: weights of a text-to-image model; its network is changed in place.
        variant: name of the conditioning.
        seed: seed of the initial weights of ControlNet's image encoder.

    Raises:
        InputError: if the variant is unknown, or the network takes more than the noisy latents.
    """
    one_of("variant", variant, VARIANTS)
    unet, bare = weights.unet, weights.vae.config["latent_channels"]
    if unet.config["in_channels"] != bare or weights.controlnet:
        rule = f"must be of a text-to-image model with {bare} input channels"
        got = f"{unet.config['in_channels']}" + (" and controlnet/" if weights.controlnet else "")
        raise refuse("weights", rule, got, "Give published weights, not weights trained here.")
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


def trained_conditioning(weights: Weights) -> Conditioning:
    """Restore the conditioning of weights that were trained for completion.

    Raises:
        InputError: if the weights were not trained for completion.
    """
    if weights.controlnet is not None:
        return Controlled(weights.unet, weights.controlnet)
    wide = _LATENTS * weights.vae.config["latent_channels"]
    if (inputs := weights.unet.config["in_channels"]) not in (wide, wide + 1):
        rule = f"must be trained for completion, with {wide} or {wide + 1} input channels"
        raise refuse("weights", rule, inputs, "Train first, from these weights.")
    return Concatenated(weights.unet)


def trainable_parameters(conditioning: Conditioning) -> list[nn.Parameter]:
    """Return the parameters that are trained."""
    parameters = chain.from_iterable(part.parameters() for part in conditioning.networks.values())
    return [parameter for parameter in parameters if parameter.requires_grad]


def widen(network: UNet2DConditionModel, *, copies: int, further: int) -> None:
    """Let the first layer take several latents at once, and additional channels.

    Its weights are repeated for each latent and divided by their number (the paper's sec. 3). For
    equal latents, the output does not change. Weights of additional channels start at zero, so that
    these channels have no effect before training.

    Args:
        network: is changed in place, with its configuration.
        copies: number of latents.
        further: number of additional channels.
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
