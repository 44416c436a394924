"""Sampling of depth by DDIM without noise between steps (Song et al., ICLR 2021)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor

from starling.learning.completion.diffusion import span
from starling.learning.completion.diffusion.model import DiffusionModel
from starling.learning.completion.diffusion.span import NetworkInput
from starling.sim.randomness import generator


def sample(
    model: DiffusionModel, inputs: NetworkInput, *, steps: int, seed: int, count: int
) -> Iterator[Tensor]:
    """Sample depth maps of frames.

    Args:
        model: the diffusion model.
        inputs: inputs (b, ...) whose height and width are multiples of `model.multiple`.
        steps: denoising steps.
        seed: seed of the initial noise, which is the same on every device.
        count: depth maps a frame.

    Yields:
        Depth (b, h, w) as `Span` encodes it.
    """
    scheduler: Any = DDIMScheduler.from_config(model.scheduler.config)
    scheduler.set_timesteps(steps, device=model.text.device)
    with torch.inference_mode():
        condition = model.conditioning.condition(inputs, model.vae)
    for number in range(count):
        # Not around the `yield`: inference mode would stay on in the caller.
        with torch.inference_mode():
            depth = _denoise(
                model, scheduler, condition, _initial_noise(model, inputs, seed, number)
            )
        yield depth


def _denoise(model: DiffusionModel, scheduler: Any, condition: Tensor, noisy: Tensor) -> Tensor:
    """Denoise latents (b, 4, h, w) and decode them to depth (b, h, w)."""
    batch, clean = len(noisy), noisy
    text = model.text.expand(batch, -1, -1)
    for step in scheduler.timesteps:
        noise = model.conditioning.noise(noisy, step.expand(batch), condition, text)
        noisy, clean = scheduler.step(noise, step, noisy, return_dict=False)
    # Not `noisy`: Stable Diffusion's schedule ends with some noise.
    return span.decode_depth(model.vae, clean)


def _initial_noise(model: DiffusionModel, inputs: NetworkInput, seed: int, number: int) -> Tensor:
    """Draw the initial noise of one sample."""
    batch, _, height, width = inputs.image.shape
    side = span.factor(model.vae)
    size = (batch, model.vae.config["latent_channels"], height // side, width // side)
    noise = generator(seed, number, "completion", "diffusion").standard_normal(size)
    return torch.from_numpy(noise.astype(np.float32)).to(model.text.device)
