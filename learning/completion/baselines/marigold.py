"""Depth from the image alone by diffusion (Ke et al., Repurposing, CVPR 2024: Marigold)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from diffusers.pipelines.marigold.pipeline_marigold_depth import MarigoldDepthPipeline

from starling.learning.completion.alignment import align_depth, least_squares
from starling.learning.completion.diffusion import weights
from starling.learning.completion.method import Completed, CompletionFrame, unknown_sigma
from starling.learning.networks.device import device
from starling.patterns.errors import in_interval, refuse

PUBLISHED = "prs-eth/marigold-depth-v1-0"
_SPREAD_FROM = 3  # Least number of samples from which the pipeline estimates a spread.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Marigold:
    """Affine-invariant depth, aligned by least squares to the sensor's depth.

    The paper aligns to the ground truth, which is not available on a robot.
    """

    name: ClassVar[str] = "marigold"
    pipeline: MarigoldDepthPipeline
    steps: int = 50  # Denoising steps, as in Marigold's paper.
    count: int = 10  # Samples that are combined, as in Marigold's paper.
    longest_px: int = 768  # Longer side of the network's input.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("count", self.count, 1, 1000)
        in_interval("longest_px", self.longest_px, 8, 16384)

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame of any size.

        Raises:
            InputError: if the depth cannot be aligned (`alignment.least_squares`).
        """
        output: Any = self.pipeline(
            torch.from_numpy(np.moveaxis(frame.rgb, -1, 0)[None].copy()),
            num_inference_steps=self.steps,
            ensemble_size=self.count,
            processing_resolution=self.longest_px,
            generator=torch.Generator().manual_seed(self.seed),
            output_uncertainty=self.count >= _SPREAD_FROM,
        )
        prediction = np.asarray(output.prediction)[0, :, :, 0]
        if output.uncertainty is None:
            sigma = unknown_sigma(frame)
        else:
            scale = least_squares(prediction, frame.depth_m, frame.valid).scale
            sigma = abs(scale) * np.asarray(output.uncertainty)[0, :, :, 0]
        depth = align_depth(prediction, frame.depth_m, frame.valid)
        return Completed(depth_m=depth, sigma_m=sigma.astype(np.float32))


def load(source: Path | str) -> Marigold:
    """Read published weights.

    Args:
        source: folder of the weights, or an id on the Hugging Face hub.

    Raises:
        InputError: see `read_weights`.
    """
    read = read_weights(source)
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
    return Marigold(pipeline=pipeline.to(device()))


def read_weights(source: Path | str) -> weights.Weights:
    """Read Marigold's weights.

    Raises:
        InputError: see `weights.load`; or if the network does not take exactly two latents.
    """
    read = weights.load(source, published=PUBLISHED)
    wide = 2 * read.vae.config["latent_channels"]
    if (inputs := read.unet.config["in_channels"]) != wide:
        rule = f"must be Marigold's, with {wide} input channels"
        raise refuse("weights", rule, inputs, f"Give the weights of {PUBLISHED}.")
    return read
