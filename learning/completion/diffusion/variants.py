"""Names of the ways in which the denoising network is told what is seen."""

from __future__ import annotations

from typing import Literal

Variant = Literal["rgbd", "rgbd-mask", "controlnet"]
VARIANTS: tuple[Variant, ...] = ("rgbd", "rgbd-mask", "controlnet")
