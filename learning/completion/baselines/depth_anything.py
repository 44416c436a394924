"""Depth from the image alone by a transformer (Yang et al., Depth Anything V2, NeurIPS 2024)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from transformers import DepthAnythingForDepthEstimation

from starling.learning.completion.alignment import aligned_inverse, normalisation
from starling.learning.completion.diffusion import reading
from starling.learning.completion.diffusion.published import folder
from starling.learning.completion.frame import Frame
from starling.learning.completion.method import Completed, untold
from starling.learning.networks.training.learner import device
from starling.patterns.errors import in_interval, positive, refuse

PUBLISHED = "depth-anything/Depth-Anything-V2-Small-hf"
_FILES = ("config.json", "model.safetensors")
# Of ImageNet's images, red, green, blue: what its encoder has learnt on.
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_SIGMA = np.array([0.229, 0.224, 0.225], np.float32)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthAnything:
    """Inverse depth, aligned by least squares to the inverse of the depth that the sensor has.

    The paper at hand aligns to the truth, which a robot has not.
    """

    network: Any  # A `DepthAnythingForDepthEstimation`.
    shortest_px: int = 518  # Of the image that it sees, about, as published.
    farthest_m: float = 20.0  # What is told to be farther is put there, or as far as the sensor
    # has depth (98th percentile): of streets, 20 m are little.

    def __post_init__(self) -> None:
        in_interval("shortest_px", self.shortest_px, 1, 16384)
        positive("farthest_m", self.farthest_m)

    @property
    def name(self) -> str:
        """Depth Anything V2."""
        return "depth-anything"

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame of any size.

        Raises:
            InputError: if its depth cannot be aligned to (`alignment.least_squares`).
        """
        height, width = frame.shape
        ratio = self.shortest_px / min(height, width)
        patch = self.network.config.patch_size
        rows, columns = (max(1, round(side * ratio / patch)) * patch for side in frame.shape)
        resized = cv2.resize(frame.rgb, (columns, rows), interpolation=cv2.INTER_CUBIC)
        seen = (resized - _MEAN) / _SIGMA
        pixels = torch.from_numpy(np.moveaxis(seen, -1, 0)[None].copy())
        with torch.inference_mode():
            told = self.network(pixel_values=pixels.to(self.network.device)).predicted_depth[0]
        inverse = cv2.resize(told.cpu().numpy(), (width, height), interpolation=cv2.INTER_LINEAR)
        farthest_m = max(self.farthest_m, normalisation(frame.depth_m, frame.valid).high_m)
        depth = aligned_inverse(inverse, frame.depth_m, frame.valid, farthest_m=farthest_m)
        return Completed(depth_m=depth, sigma_m=untold(frame))


def load(source: Path | str) -> DepthAnything:
    """Read published weights.

    Args:
        source: their folder, or a hub's id.

    Raises:
        InputError: as `published.folder` and `reading.network`; if they tell metres, which are
            depth and not its inverse.
    """
    path = folder(source, published=PUBLISHED, files=_FILES)
    network = reading.network(DepthAnythingForDepthEstimation, path, published=PUBLISHED)
    if network.config.depth_estimation_type != "relative":
        rule, got = "must tell relative depth", f"{network.config.depth_estimation_type} in {path}"
        raise refuse("weights", rule, got, f"Give those of {PUBLISHED}.")
    return DepthAnything(network=network.to(device()))
