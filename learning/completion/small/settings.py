"""How long and in what portions the network learns."""

from __future__ import annotations

from dataclasses import dataclass

from patterns import errors


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """Steps, batches and rates; the defaults take under an hour on two processor cores."""

    steps: int = 3000
    batch: int = 8  # Crops a step.
    crop_px: tuple[int, int] = (256, 384)  # (h, w)
    rate: float = 2e-3  # Highest learning rate.
    weight_decay: float = 1e-3
    averaging: float = 0.995  # Share that the running average of weights keeps a step.
    save_every: int = 100  # Steps between checkpoints.

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "save_every"):
            errors.in_interval(name, getattr(self, name), 1, 10_000_000)
        for side in self.crop_px:
            errors.in_interval("crop_px", side, 1, 16384, "Give height and width [px].")
        errors.positive("rate", self.rate)
        errors.in_interval("weight_decay", self.weight_decay, 0.0, 1.0)
        errors.in_interval("averaging", self.averaging, 0.0, 1.0)
