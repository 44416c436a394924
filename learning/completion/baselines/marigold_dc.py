"""Marigold guided by the sensor's depth during denoising.

Source: Viola et al., Marigold-DC: zero-shot monocular depth completion with guided diffusion, ICCV
2025. Learning rates and the length of the gradient are those of its published settings.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.completion.baselines import marigold
from starling.learning.completion.diffusion import span
from starling.learning.completion.diffusion.span import pad_edges
from starling.learning.completion.diffusion.weights import empty_prompt
from starling.learning.completion.method import Completed, CompletionFrame, unknown_sigma
from starling.learning.networks.device import device
from starling.patterns.errors import in_interval
from starling.sim.randomness import generator

_LATENT_RATE = 0.05  # Learning rate of the latent.
_AFFINE_RATE = 0.005  # Learning rate of scale and shift.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MarigoldDC:
    """Compares the final depth that each step predicts with the sensor's valid depth.

    The loss is the mean of |e| + e^2 over valid pixels. Adam optimises the latent, scale s and
    shift t. Metres are s^2 (c_max - c_min) d + t^2 c_min (equation 2), where c is the sensor's
    depth.
    """

    name: ClassVar[str] = "marigold-dc"
    unet: UNet2DConditionModel
    vae: AutoencoderKL
    scheduler: DDIMScheduler
    text: Tensor  # (1, n, d) encoded empty prompt.
    steps: int = 50
    longest_px: int = 768  # Longer side of the network's input.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("longest_px", self.longest_px, 8, 16384)

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame of any size."""
        known = torch.from_numpy(frame.depth_m[frame.valid]).to(self.text.device)
        valid = torch.from_numpy(frame.valid).to(self.text.device)
        image, size = self._image(frame)
        with torch.no_grad():
            encoded_image = span.encode(self.vae, image)
        noise = generator(self.seed, 0, "completion", self.name).standard_normal(
            encoded_image.shape
        )
        latent = nn.Parameter(torch.from_numpy(noise.astype(np.float32)).to(encoded_image.device))
        affine = nn.Parameter(torch.ones(2, device=encoded_image.device))  # s and t.
        optimizer = optim.Adam(
            [{"params": [affine], "lr": _AFFINE_RATE}, {"params": [latent], "lr": _LATENT_RATE}]
        )

        def metres(clean: Tensor) -> Tensor:
            depth = span.decode_depth(self.vae, clean).clamp(-1, 1) / 2 + 0.5
            depth = depth[None, :, : size[0], : size[1]]
            depth = functional.interpolate(depth, frame.shape, mode="bilinear")[0, 0]
            low, high = known.min(), known.max()
            return affine[0] ** 2 * (high - low) * depth + affine[1] ** 2 * low

        scheduler: Any = DDIMScheduler.from_config(self.scheduler.config, clip_sample=False)
        scheduler.set_timesteps(self.steps, device=encoded_image.device)
        for step in scheduler.timesteps:
            optimizer.zero_grad()
            predicted = self.unet(
                torch.cat([encoded_image, latent], dim=1),
                step,
                encoder_hidden_states=self.text,
                return_dict=False,
            )[0]
            clean = scheduler.step(predicted, step, latent).pred_original_sample
            error = metres(clean)[valid] - known
            (error.abs().mean() + (error**2).mean()).backward()
            _lengthen(latent, clean, scheduler.alphas_cumprod[step])
            optimizer.step()
            with torch.no_grad():
                latent.copy_(scheduler.step(predicted, step, latent).prev_sample)
        with torch.no_grad():
            depth = metres(latent).cpu().numpy()
        return Completed(depth_m=depth, sigma_m=unknown_sigma(frame))

    def _image(self, frame: CompletionFrame) -> tuple[Tensor, tuple[int, int]]:
        """Return the resized, padded image (1, 3, h, w), and its size before padding."""
        height, width = frame.shape
        ratio = self.longest_px / max(height, width)
        size = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        interpolation = cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR
        resized = cv2.resize(frame.rgb, size[::-1], interpolation=interpolation)
        channels = pad_edges(np.moveaxis(resized, -1, 0) * 2 - 1, span.factor(self.vae))
        return torch.from_numpy(channels[None]).to(self.text.device), size


def load(source: Path | str) -> MarigoldDC:
    """Read Marigold's published weights.

    Args:
        source: folder of the weights, or an id on the Hugging Face hub.

    Raises:
        InputError: see `marigold.read_weights`.
    """
    parts = marigold.read_weights(source)
    text = empty_prompt(parts.text_encoder, parts.tokenizer)
    nn.ModuleList([parts.unet, parts.vae]).to(device())
    return MarigoldDC(
        unet=parts.unet,
        vae=parts.vae,
        scheduler=parts.scheduler,
        text=text.to(device()),
    )


def _lengthen(latent: nn.Parameter, clean: Tensor, alpha: Tensor) -> None:
    """Scale the latent's gradient to the length of the noise in the latent."""
    with torch.no_grad():
        noise = (latent - alpha.sqrt() * clean) / (1 - alpha).sqrt()
        if latent.grad is not None:
            length = torch.linalg.vector_norm(latent.grad).clamp(min=1e-8)
            latent.grad *= torch.linalg.vector_norm(noise) / length
