"""Diffusion as a completion method."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.learning.completion.diffusion.model import DiffusionModel, trained_model
from starling.learning.completion.diffusion.sampling import sample
from starling.learning.completion.diffusion.span import Span, network_input
from starling.learning.completion.method import Completed, CompletionFrame, Image
from starling.patterns.errors import in_interval


@dataclass(frozen=True, kw_only=True, slots=True)
class Diffusion:
    """Predicts depth at all pixels. Scale and shift come from the sensor's depth.

    As in the paper, the sensor's depth is not copied to the output, because it is noisy.
    """

    model: DiffusionModel
    steps: int = 50  # Denoising steps: Marigold's number; the paper does not state its own.
    count: int = 1  # Samples to average. Their spread is estimated from two samples on.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("count", self.count, 1, 1000)

    @property
    def name(self) -> str:
        """Name of the method, with its conditioning."""
        return f"diffusion-{self.model.conditioning.variant}"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame of any size."""
        model, span = self.model, Span.from_frame(frame)
        inputs = network_input([frame], multiple=model.multiple, device=model.text.device)
        height, width = frame.shape
        samples = [
            span.decode(depth[0, :height, :width].float().cpu().numpy())
            for depth in sample(model, inputs, steps=self.steps, seed=self.seed, count=self.count)
        ]
        mean, sigma = mean_and_std(np.stack(samples))
        return Completed(depth_m=mean, sigma_m=sigma)


def load(source: Path | str) -> Diffusion:
    """Read a trained model.

    Args:
        source: the folder `weights` that training writes, or an id on the Hugging Face hub.

    Raises:
        InputError: see `trained_model`.
    """
    return Diffusion(model=trained_model(source))


def mean_and_std(samples_m: Image) -> tuple[Image, Image]:
    """Mean and standard deviation of depth samples.

    Args:
        samples_m: (n, h, w) [m].

    Returns:
        Mean (h, w) [m], NaN where a sample is NaN; and the sample standard deviation (h, w) [m],
        NaN for n = 1.
    """
    mean = samples_m.mean(axis=0, dtype=np.float64)
    if len(samples_m) < 2:
        return mean.astype(np.float32), np.full_like(samples_m[0], np.nan)
    return mean.astype(np.float32), samples_m.std(axis=0, ddof=1, dtype=np.float64).astype(
        np.float32
    )
