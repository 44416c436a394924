"""Depth from the image alone by a transformer (Yang et al., Depth Anything V2, NeurIPS 2024)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
import torch
from transformers import DepthAnythingForDepthEstimation

from starling.learning.completion.alignment import align_inverse_depth, normalisation
from starling.learning.completion.diffusion.weights import find_weights, read_network
from starling.learning.completion.method import Completed, CompletionFrame, unknown_sigma
from starling.learning.networks.device import device
from starling.patterns.errors import in_interval, refuse

PUBLISHED = "depth-anything/Depth-Anything-V2-Small-hf"
_FILES = ("config.json", "model.safetensors")
# Greatest depth of the result [m]. The 98th percentile of the sensor's depth replaces it where that
# is greater, as in streets.
_FARTHEST_M = 20.0
# Mean and standard deviation of ImageNet's red, green and blue, which the encoder was trained on.
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_SIGMA = np.array([0.229, 0.224, 0.225], np.float32)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthAnything:
    """Inverse depth, aligned by least squares to the inverse of the sensor's depth.

    The paper aligns to the ground truth, which is not available on a robot.
    """

    name: ClassVar[str] = "depth-anything"
    network: Any  # A `DepthAnythingForDepthEstimation`.
    shortest_px: int = 518  # Shorter side of the network's input, about, as published.

    def __post_init__(self) -> None:
        in_interval("shortest_px", self.shortest_px, 1, 16384)

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame of any size.

        Raises:
            InputError: if the depth cannot be aligned (`alignment.least_squares`).
        """
        height, width = frame.shape
        ratio = self.shortest_px / min(height, width)
        patch = self.network.config.patch_size
        rows, columns = (max(1, round(side * ratio / patch)) * patch for side in frame.shape)
        resized = cv2.resize(frame.rgb, (columns, rows), interpolation=cv2.INTER_CUBIC)
        normalised = (resized - _MEAN) / _SIGMA
        pixels = torch.from_numpy(np.moveaxis(normalised, -1, 0)[None].copy())
        with torch.inference_mode():
            predicted = self.network(pixel_values=pixels.to(self.network.device)).predicted_depth[0]
        inverse = cv2.resize(
            predicted.cpu().numpy(), (width, height), interpolation=cv2.INTER_LINEAR
        )
        farthest_m = max(_FARTHEST_M, normalisation(frame.depth_m, frame.valid).high_m)
        depth = align_inverse_depth(inverse, frame.depth_m, frame.valid, farthest_m=farthest_m)
        return Completed(depth_m=depth, sigma_m=unknown_sigma(frame))


def load(source: Path | str) -> DepthAnything:
    """Read published weights.

    Args:
        source: folder of the weights, or an id on the Hugging Face hub.

    Raises:
        InputError: see `find_weights` and `read_network`; or if the network predicts metres, which
            are depth and not inverse depth.
    """
    path = find_weights(source, published=PUBLISHED, files=_FILES)
    network = read_network(DepthAnythingForDepthEstimation, path, published=PUBLISHED)
    if network.config.depth_estimation_type != "relative":
        rule, got = (
            "must predict relative depth",
            f"{network.config.depth_estimation_type} in {path}",
        )
        raise refuse("weights", rule, got, f"Give the weights of {PUBLISHED}.")
    return DepthAnything(network=network.to(device()))
