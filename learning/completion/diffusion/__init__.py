"""Depth completion by latent diffusion, conditioned on the image and the sensor's depth.

Source: Cuaran, Mai, Ahluwalia and Wu, Enhancing stereo depth maps through RGBD-conditioned
generative models (University of Illinois, 2024), after Marigold (Ke et al., CVPR 2024).
"""

from __future__ import annotations

from typing import Literal

Variant = Literal["rgbd", "rgbd-mask", "controlnet"]
VARIANTS: tuple[Variant, ...] = ("rgbd", "rgbd-mask", "controlnet")
