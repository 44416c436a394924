"""Diffusion as a method of completion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.learning.completion.diffusion.model import Model, trained
from starling.learning.completion.diffusion.sampling import sample
from starling.learning.completion.diffusion.seen import look
from starling.learning.completion.diffusion.span import Span
from starling.learning.completion.diffusion.spread import joined
from starling.learning.completion.frame import Frame
from starling.learning.completion.method import Completed
from starling.patterns.errors import in_interval


@dataclass(frozen=True, kw_only=True, slots=True)
class Diffusion:
    """Depth everywhere by the network, in metres by the sensor depth's own scale and shift.

    Depth that the sensor has is not put back: it is noisy, and the paper gives the network's.
    """

    model: Model
    steps: int = 50  # Of denoising: Marigold's number; the paper gives none for its T.
    count: int = 1  # Depths drawn, whose mean is given; their spread is told from two on.
    seed: int = 0

    def __post_init__(self) -> None:
        in_interval("steps", self.steps, 1, 1000)
        in_interval("count", self.count, 1, 1000)

    @property
    def name(self) -> str:
        """Diffusion, and how it is told what is seen."""
        return f"diffusion-{self.model.conditioning.variant}"

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame of any size."""
        model, span = self.model, Span.of(frame)
        seen = look([frame], multiple=model.multiple, where=model.text.device)
        height, width = frame.shape
        drawn = [
            span.metres(depth[0, :height, :width].float().cpu().numpy())
            for depth in sample(model, seen, steps=self.steps, seed=self.seed, count=self.count)
        ]
        mean, sigma = joined(np.stack(drawn))
        return Completed(depth_m=mean, sigma_m=sigma)


def load(source: Path | str, *, steps: int = 50, count: int = 1, seed: int = 0) -> Diffusion:
    """Read a trained model.

    Args:
        source: the folder `weights` that training leaves, or a hub's id.
        steps: as `Diffusion`'s.
        count: as `Diffusion`'s.
        seed: as `Diffusion`'s.

    Raises:
        InputError: as `trained`; if a number is out of range.
    """
    return Diffusion(model=trained(source), steps=steps, count=count, seed=seed)
