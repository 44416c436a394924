"""A diffusion model for completion: its networks, its noise, and what it is told of frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor, nn

from starling.learning.completion.diffusion import latents, weights
from starling.learning.completion.diffusion.conditioning import Conditioning, begin, learnt
from starling.learning.completion.diffusion.text import empty_prompt
from starling.learning.completion.diffusion.variants import Variant
from starling.learning.completion.diffusion.weights import Weights
from starling.learning.networks.training.learner import device


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Model:
    """What denoises, on its device, and what stays as it is while that learns."""

    conditioning: Conditioning
    vae: AutoencoderKL
    scheduler: DDIMScheduler  # The noise schedule, and what the network tells.
    text: Tensor  # (1, n, d) the empty prompt.

    @property
    def multiple(self) -> int:
        """Of what height and width must be [px], for all halvings to come out; 64 for SD 2."""
        unet: Any = self.conditioning.networks["unet"]
        levels = len(unet.config["block_out_channels"])
        return latents.factor(self.vae) * 2 ** (levels - 1)


def untrained(parts: Weights, variant: Variant, *, seed: int) -> Model:
    """Make a model to be trained of a text-to-image model's weights.

    It is to tell the noise, as in the paper, whatever the weights told; the noise schedule stays.

    Raises:
        InputError: as `begin`.
    """
    conditioning = begin(parts, variant, seed=seed)
    scheduler: Any = DDIMScheduler.from_config(
        parts.scheduler.config, prediction_type="epsilon", clip_sample=False
    )
    return _placed(parts, conditioning, scheduler)


def trained(source: Path | str) -> Model:
    """Read a model that `training.train` has left in a folder, or that lies on the hub.

    Raises:
        InputError: as `weights.load`; if it was not trained for completion.
    """
    parts = weights.load(source, published=None)
    return _placed(parts, learnt(parts), parts.scheduler)


def _placed(parts: Weights, conditioning: Conditioning, scheduler: DDIMScheduler) -> Model:
    text = empty_prompt(parts.text_encoder, parts.tokenizer)
    where = device()
    nn.ModuleList([parts.vae, conditioning.networks]).to(where)
    return Model(
        conditioning=conditioning,
        vae=parts.vae,
        scheduler=scheduler,
        text=text.to(where, torch.float32),
    )
