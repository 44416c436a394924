"""Depth out of noise: DDIM (Song et al., ICLR 2021), without noise between its steps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor

from starling.learning.completion.diffusion import latents
from starling.learning.completion.diffusion.model import Model
from starling.learning.completion.diffusion.seen import Seen
from starling.sim.randomness import generator


def sample(model: Model, seen: Seen, *, steps: int, seed: int, count: int) -> Iterator[Tensor]:
    """Draw depths of frames, one after the other.

    Args:
        model: any.
        seen: (b, ...), of a size that is a multiple of `model.multiple`.
        steps: of denoising.
        seed: fixes all noise, the same on every device.
        count: how many depths to draw of each frame.

    Yields:
        Depth (b, h, w) as `Span` encodes it.
    """
    scheduler: Any = DDIMScheduler.from_config(model.scheduler.config)
    scheduler.set_timesteps(steps, device=model.text.device)
    with torch.inference_mode():
        condition = model.conditioning.condition(seen, model.vae)
    for number in range(count):
        # Not around the `yield`: the mode would stay on for whoever asks for the next.
        with torch.inference_mode():
            depth = _drawn(model, scheduler, condition, _start(model, seen, seed, number))
        yield depth


def _drawn(model: Model, scheduler: Any, condition: Tensor, noisy: Tensor) -> Tensor:
    """Take the noise out of latents (b, 4, h, w), step by step; the depth (b, h, w)."""
    batch, clean = len(noisy), noisy
    text = model.text.expand(batch, -1, -1)
    for step in scheduler.timesteps:
        noise = model.conditioning.noise(noisy, step.expand(batch), condition, text)
        noisy, clean = scheduler.step(noise, step, noisy, return_dict=False)
    # Not `noisy`: Stable Diffusion's schedule ends with a little noise left.
    return latents.decode_depth(model.vae, clean)


def _start(model: Model, seen: Seen, seed: int, number: int) -> Tensor:
    batch, _, height, width = seen.image.shape
    side = latents.factor(model.vae)
    size = (batch, model.vae.config["latent_channels"], height // side, width // side)
    noise = generator(seed, number, "completion", "diffusion").standard_normal(size)
    return torch.from_numpy(noise.astype(np.float32)).to(model.text.device)
