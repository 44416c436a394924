"""Marigold guided by the sensor's depth while it denoises.

Source: Viola et al., Marigold-DC: zero-shot monocular depth completion with guided diffusion, ICCV
2025; rates and the length of the gradient as in its published settings.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.completion.baselines import marigold
from starling.learning.completion.diffusion import latents
from starling.learning.completion.diffusion.seen import padded
from starling.learning.completion.diffusion.text import empty_prompt
from starling.learning.completion.frame import Frame
from starling.learning.completion.method import Completed, untold
from starling.learning.networks.training.learner import device
from starling.patterns.errors import in_interval
from starling.sim.randomness import generator

_LATENT_RATE = 0.05
_AFFINE_RATE = 0.005


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MarigoldDC:
    """Each step, the depth that it would end in is held against the sensor's, where that is valid.

    Loss |e| + e^2, its mean over valid pixels; Adam on the latent, and on the scale s and shift t
    of metres = s^2 (c_max - c_min) d + t^2 c_min (equation 2), c being the sensor's depth.
    """

    unet: UNet2DConditionModel
    vae: AutoencoderKL
    scheduler: DDIMScheduler
    text: Tensor  # (1, n, d) the empty prompt.
    steps: int = 50
    longest_px: int = 768  # Of the image that it sees.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("longest_px", self.longest_px, 8, 16384)

    @property
    def name(self) -> str:
        """Marigold-DC."""
        return "marigold-dc"

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame of any size."""
        known = torch.from_numpy(frame.depth_m[frame.valid]).to(self.text.device)
        valid = torch.from_numpy(frame.valid).to(self.text.device)
        image, size = self._image(frame)
        with torch.no_grad():
            seen = latents.encode(self.vae, image)
        noise = generator(self.seed, 0, "completion", self.name).standard_normal(seen.shape)
        latent = nn.Parameter(torch.from_numpy(noise.astype(np.float32)).to(seen.device))
        affine = nn.Parameter(torch.ones(2, device=seen.device))  # s and t.
        optimizer = optim.Adam(
            [{"params": [affine], "lr": _AFFINE_RATE}, {"params": [latent], "lr": _LATENT_RATE}]
        )

        def metres(clean: Tensor) -> Tensor:
            depth = latents.decode_depth(self.vae, clean).clamp(-1, 1) / 2 + 0.5
            depth = depth[None, :, : size[0], : size[1]]
            depth = functional.interpolate(depth, frame.shape, mode="bilinear")[0, 0]
            low, high = known.min(), known.max()
            return affine[0] ** 2 * (high - low) * depth + affine[1] ** 2 * low

        scheduler: Any = DDIMScheduler.from_config(self.scheduler.config, clip_sample=False)
        scheduler.set_timesteps(self.steps, device=seen.device)
        for step in scheduler.timesteps:
            optimizer.zero_grad()
            told = self.unet(
                torch.cat([seen, latent], dim=1),
                step,
                encoder_hidden_states=self.text,
                return_dict=False,
            )[0]
            clean = scheduler.step(told, step, latent).pred_original_sample
            wrong = metres(clean)[valid] - known
            (wrong.abs().mean() + (wrong**2).mean()).backward()
            _lengthen(latent, clean, scheduler.alphas_cumprod[step])
            optimizer.step()
            with torch.no_grad():
                latent.copy_(scheduler.step(told, step, latent).prev_sample)
        with torch.no_grad():
            depth = metres(latent).cpu().numpy()
        return Completed(depth_m=depth, sigma_m=untold(frame))

    def _image(self, frame: Frame) -> tuple[Tensor, tuple[int, int]]:
        """The image at the size that it is seen in (1, 3, h, w), and that size before padding."""
        height, width = frame.shape
        ratio = self.longest_px / max(height, width)
        size = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        how = cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR
        resized = cv2.resize(frame.rgb, size[::-1], interpolation=how)
        channels = padded(np.moveaxis(resized, -1, 0) * 2 - 1, latents.factor(self.vae))
        return torch.from_numpy(channels[None]).to(self.text.device), size


def load(source: Path | str, *, steps: int = 50, seed: int = 0) -> MarigoldDC:
    """Read Marigold's published weights.

    Args:
        source: their folder, or a hub's id.
        steps: as `MarigoldDC`'s.
        seed: as `MarigoldDC`'s.

    Raises:
        InputError: as `marigold.parts`; if a number is out of range.
    """
    parts = marigold.parts(source)
    text = empty_prompt(parts.text_encoder, parts.tokenizer)
    nn.ModuleList([parts.unet, parts.vae]).to(device())
    return MarigoldDC(
        unet=parts.unet,
        vae=parts.vae,
        scheduler=parts.scheduler,
        text=text.to(device()),
        steps=steps,
        seed=seed,
    )


def _lengthen(latent: nn.Parameter, clean: Tensor, kept: Tensor) -> None:
    """Give the latent's gradient the length of the noise that is in it, whatever it was told as."""
    with torch.no_grad():
        noise = (latent - kept.sqrt() * clean) / (1 - kept).sqrt()
        if latent.grad is not None:
            length = torch.linalg.vector_norm(latent.grad).clamp(min=1e-8)
            latent.grad *= torch.linalg.vector_norm(noise) / length
