"""Training settings of networks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from starling.patterns import errors


@dataclass(frozen=True, kw_only=True, slots=True)
class Schedule:
    """Steps, batches and rates."""

    steps: int
    batch: int = 8  # Crops a step.
    crop_px: tuple[int, int]  # (h, w)
    rate: float = 2e-3  # Highest learning rate.
    weight_decay: float
    averaging: float  # Decay of the running average of weights per step.
    save_every: int  # Steps between checkpoints.

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "save_every"):
            errors.in_interval(name, getattr(self, name), 1, 10_000_000)
        for side in self.crop_px:
            errors.in_interval("crop_px", side, 1, 16384, "Give height and width [px].")
        errors.positive("rate", self.rate)
        errors.in_interval("weight_decay", self.weight_decay, 0.0, 1.0)
        errors.in_interval("averaging", self.averaging, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingSettings(Schedule):
    """Settings of networks that predict no-depth pixels; training takes minutes on two cores."""

    steps: int = 600
    crop_px: tuple[int, int] = (192, 384)  # (h, w); wide, because occlusions extend along rows.
    weight_decay: float = 1e-2
    averaging: float = 0.99
    save_every: int = 50
    hidden: float = 0.75  # Share of crops in which the physics channels are hidden.
    start: Path | None = None  # Folder with initial weights; None starts from scratch.

    def __post_init__(self) -> None:
        Schedule.__post_init__(self)  # `super()` does not work in a dataclass with slots.
        errors.in_interval("hidden", self.hidden, 0.0, 1.0)


def settings_identity(settings: object) -> str:
    """Text of training settings in checkpoint identities; the class's name does not count."""
    return repr(settings).replace(type(settings).__name__, "Settings", 1)
