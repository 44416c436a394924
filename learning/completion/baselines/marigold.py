"""Depth from the image alone by diffusion (Ke et al., Repurposing, CVPR 2024: Marigold)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from diffusers.pipelines.marigold.pipeline_marigold_depth import MarigoldDepthPipeline

from starling.learning.completion.alignment import aligned, least_squares
from starling.learning.completion.diffusion import weights
from starling.learning.completion.frame import Frame
from starling.learning.completion.method import Completed, untold
from starling.learning.networks.training.learner import device
from starling.patterns.errors import in_interval, refuse

PUBLISHED = "prs-eth/marigold-depth-v1-0"
_SPREAD_FROM = 3  # Depths, of which the pipeline tells how far they differ.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Marigold:
    """Affine-invariant depth, aligned by least squares to the depth that the sensor has.

    The paper at hand aligns to the truth, which a robot has not.
    """

    pipeline: MarigoldDepthPipeline
    steps: int = 50  # Of denoising, and
    count: int = 10  # depths drawn and joined: as in Marigold's figures.
    longest_px: int = 768  # Of the image that it sees.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("count", self.count, 1, 1000)
        in_interval("longest_px", self.longest_px, 8, 16384)

    @property
    def name(self) -> str:
        """Marigold."""
        return "marigold"

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame of any size.

        Raises:
            InputError: if its depth cannot be aligned to (`alignment.least_squares`).
        """
        output: Any = self.pipeline(
            torch.from_numpy(np.moveaxis(frame.rgb, -1, 0)[None].copy()),
            num_inference_steps=self.steps,
            ensemble_size=self.count,
            processing_resolution=self.longest_px,
            generator=torch.Generator().manual_seed(self.seed),
            output_uncertainty=self.count >= _SPREAD_FROM,
        )
        told = np.asarray(output.prediction)[0, :, :, 0]
        if output.uncertainty is None:
            sigma = untold(frame)
        else:
            scale = least_squares(told, frame.depth_m, frame.valid).scale
            sigma = abs(scale) * np.asarray(output.uncertainty)[0, :, :, 0]
        depth = aligned(told, frame.depth_m, frame.valid)
        return Completed(depth_m=depth, sigma_m=sigma.astype(np.float32))


def load(source: Path | str, *, steps: int = 50, count: int = 10, seed: int = 0) -> Marigold:
    """Read published weights.

    Args:
        source: their folder, or a hub's id.
        steps: as `Marigold`'s.
        count: as `Marigold`'s.
        seed: as `Marigold`'s.

    Raises:
        InputError: as `parts`; if a number is out of range.
    """
    read = parts(source)
    pipeline = MarigoldDepthPipeline(
        unet=read.unet,
        vae=read.vae,
        scheduler=read.scheduler,
        text_encoder=read.text_encoder,
        tokenizer=read.tokenizer,
        prediction_type="depth",
        scale_invariant=True,
        shift_invariant=True,
    )
    pipeline.set_progress_bar_config(disable=True)
    return Marigold(pipeline=pipeline.to(device()), steps=steps, count=count, seed=seed)


def parts(source: Path | str) -> weights.Weights:
    """Read Marigold's weights.

    Raises:
        InputError: as `weights.load`; if the network sees anything but two latents.
    """
    read = weights.load(source, published=PUBLISHED)
    wide = 2 * read.vae.config["latent_channels"]
    if (inputs := read.unet.config["in_channels"]) != wide:
        rule = f"must be Marigold's, with {wide} channels in"
        raise refuse("weights", rule, inputs, f"Give those of {PUBLISHED}.")
    return read
