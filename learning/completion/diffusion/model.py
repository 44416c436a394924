"""A diffusion model for completion: networks, noise schedule and conditioning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor, nn

from starling.learning.completion.diffusion import Variant, span, weights
from starling.learning.completion.diffusion.conditioning import (
    Conditioning,
    adapt_generator,
    trained_conditioning,
)
from starling.learning.completion.diffusion.weights import Weights, empty_prompt
from starling.learning.networks.device import device


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DiffusionModel:
    """Denoising network on its device, with the parts that training does not change."""

    conditioning: Conditioning
    vae: AutoencoderKL
    scheduler: DDIMScheduler  # Noise schedule, and the quantity that the network predicts.
    text: Tensor  # (1, n, d) encoded empty prompt.

    @property
    def multiple(self) -> int:
        """Height and width of inputs are multiples of this [px]; 64 for Stable Diffusion 2."""
        unet: Any = self.conditioning.networks["unet"]
        levels = len(unet.config["block_out_channels"])
        return span.factor(self.vae) * 2 ** (levels - 1)


def untrained_model(parts: Weights, variant: Variant, *, seed: int) -> DiffusionModel:
    """Build a model to be trained from the weights of a text-to-image model.

    The network predicts noise (epsilon), as in the paper. The noise schedule does not change.

    Raises:
        InputError: see `adapt_generator`.
    """
    conditioning = adapt_generator(parts, variant, seed=seed)
    scheduler: Any = DDIMScheduler.from_config(
        parts.scheduler.config, prediction_type="epsilon", clip_sample=False
    )
    return _placed(parts, conditioning, scheduler)


def trained_model(source: Path | str) -> DiffusionModel:
    """Read a model that `training.train` wrote to a folder, or that is on the Hugging Face hub.

    Raises:
        InputError: see `weights.load`; or if the model was not trained for completion.
    """
    parts = weights.load(source, published=None)
    return _placed(parts, trained_conditioning(parts), parts.scheduler)


def _placed(parts: Weights, conditioning: Conditioning, scheduler: DDIMScheduler) -> DiffusionModel:
    text = empty_prompt(parts.text_encoder, parts.tokenizer)
    target = device()
    nn.ModuleList([parts.vae, conditioning.networks]).to(target)
    return DiffusionModel(
        conditioning=conditioning,
        vae=parts.vae,
        scheduler=scheduler,
        text=text.to(target, torch.float32),
    )
