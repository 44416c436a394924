"""Training settings of the compact network."""

from __future__ import annotations

from dataclasses import dataclass

from starling.learning.networks.training.settings import Schedule


@dataclass(frozen=True, kw_only=True, slots=True)
class SmallSettings(Schedule):
    """Training settings. The defaults take less than half an hour on one processor core."""

    steps: int = 1500
    crop_px: tuple[int, int] = (256, 384)
    weight_decay: float = 1e-3
    averaging: float = 0.995
    save_every: int = 100
