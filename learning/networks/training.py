"""Training of networks: settings, optimisers, and a loop that can be interrupted.

The draw of a step depends on the seed and the step's number only. Training that was interrupted
continues from its last checkpoint with bit-identical results on one machine and thread count.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import torch
from torch import Tensor, nn, optim

from starling.learning.networks import checkpoint
from starling.patterns import errors
from starling.patterns.errors import refuse
from starling.sim.console import output, progress


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


_Batch = TypeVar("_Batch")
Draw = Callable[[str], _Batch]  # Draws the batch of one part of a step, by name.

_WARM_UP = 0.1  # Share of the steps in which the learning rate rises.
STEEPEST = 1.0  # Gradients are clipped to this length.


class Learner(ABC, Generic[_Batch]):
    """Networks in training. They and the optimisers hold the whole state for a restart."""

    def __init__(self, networks: Mapping[str, nn.Module], optimizers: list[optim.Optimizer]):
        self.networks = nn.ModuleDict(dict(networks))
        self.optimizers = optimizers

    @abstractmethod
    def update(self, draw: Draw[_Batch], step: int) -> dict[str, float]:
        """Take a step and return the losses before it, by name."""

    def state(self) -> dict[str, Any]:
        """Return everything that changes in training."""
        return {
            "networks": self.networks.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
        }

    def set_rate(self, rate: float) -> None:
        """Set one learning rate for all optimisers."""
        self.set_rates(*[rate] * len(self.optimizers))

    def set_rates(self, *rates: float) -> None:
        """Set the learning rate of each optimiser."""
        for optimizer, rate in zip(self.optimizers, rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = rate


def decaying_adam(network: nn.Module, decay: float) -> optim.AdamW:
    """Build an optimiser with decay of weights, but not of biases."""
    parameters = list(network.parameters())
    groups = [
        {"params": [p for p in parameters if p.ndim > 1]},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]
    return optim.AdamW(groups, weight_decay=decay)


def descend(optimizer: optim.Optimizer, loss: Tensor, *, steepest: float = math.inf) -> None:
    """Take one gradient step; gradients longer than `steepest` are clipped."""
    optimizer.zero_grad()
    loss.backward()
    parameters = [value for group in optimizer.param_groups for value in group["params"]]
    nn.utils.clip_grad_norm_(parameters, steepest)
    optimizer.step()


def mean(values: Tensor, counted: Tensor) -> Tensor:
    """Return the mean over counted pixels; 0 if none counts."""
    return (values * counted).sum() / counted.sum().clamp(min=1)


def one_cycle(step: int, settings: Schedule) -> float:
    """Return the learning rate: linear rise, then half a cosine to 0 (Smith, arXiv 1803.09820)."""
    rise = max(1.0, _WARM_UP * settings.steps)
    if step < rise:
        return settings.rate * (step + 1) / (rise + 1)
    part = (step - rise) / max(1.0, settings.steps - rise)
    return settings.rate * 0.5 * (1 + math.cos(math.pi * part))


_ENTRIES = {
    **{"identity": str, "networks": dict, "averaged": dict, "optimizers": list},
    **{"step": int, "curve": list},
}
CHECKPOINT = "training.pt"
CURVE = "loss.csv"


_Drawn = TypeVar("_Drawn", covariant=True)


class BatchSource(Protocol[_Drawn]):
    """Source of batches. Equal arguments give equal batches.

    A batch is a dataclass of images (b, c, h, w).
    """

    @property
    def identity(self) -> str:
        """Text that changes when the drawn data change."""
        ...

    def batch(self, step: int, part: str) -> _Drawn:
        """Draw the batch of one part of a step."""
        ...


@dataclass(slots=True)
class _Run:
    """State of a training run."""

    averaged: nn.ModuleDict  # Running average of the weights, the result of training.
    step: int = 0
    curve: list[dict[str, float]] = field(default_factory=list)


def train(
    learner: Learner[Any],
    batches: BatchSource[Any],
    settings: Schedule,
    *,
    kind: str,
    folder: Path,
    track: progress.Progress = progress.silent,
) -> nn.ModuleDict:
    """Train to the end, or continue from the checkpoint in `folder`.

    The returned weights are averages over the last steps (Polyak and Juditsky, SIAM J. Control
    Optim. 1992).

    Args:
        learner: freshly initialised.
        batches: source of batches.
        settings: steps and averaging.
        kind: name of the training, stored in the checkpoint.
        folder: gets `training.pt` and `loss.csv`.
        track: wraps the loop over steps.

    Returns:
        The averaged networks.

    Raises:
        InputError: if a loss is not finite (the message names the batch), or the checkpoint is
            damaged or of another training.
    """
    run = _Run(copy.deepcopy(learner.networks).requires_grad_(False))
    identity = batches.identity
    path = folder / CHECKPOINT
    if path.exists():
        with errors.naming(path):
            _resume(run, learner, checkpoint.load(path, kind, _ENTRIES), identity)
    save = partial(_save, run, learner, folder=folder, kind=kind, identity=identity)
    steps = range(run.step, settings.steps)
    for step in track(steps, f"train {kind}"):
        _step(run, learner, batches, settings, step)
        run.step = step + 1
        if run.step % settings.save_every == 0:
            save()
    if steps:
        save()
    return run.averaged.eval()


def _step(
    run: _Run, learner: Learner[Any], batches: BatchSource[Any], settings: Schedule, step: int
) -> None:
    target = next(learner.networks.parameters()).device

    def draw(part: str) -> Any:
        return _to_device(batches.batch(step, part), target)

    losses = learner.update(draw, step)
    for name, value in losses.items():
        _check_number(name, value, step)
    # The average forgets faster at first, because the initial weights are arbitrary.
    keep = min(settings.averaging, (1 + step) / (10 + step))
    with torch.no_grad():
        pairs = zip(run.averaged.parameters(), learner.networks.parameters(), strict=True)
        for mean, value in pairs:
            mean.lerp_(value, 1 - keep)
    run.curve.append({"step": float(step), **losses})


def _check_number(name: str, value: float, step: int) -> None:
    if not math.isfinite(value):
        remedy = f"Stopped at batch {step}: look at its inputs, or lower the rate."
        raise refuse(f"loss {name}", "must be a finite number", value, remedy)


def _to_device(batch: Any, target: torch.device) -> Any:
    """Copy a batch to a device, in the memory layout that is fast for convolutions."""
    images = [getattr(batch, image.name) for image in fields(batch)]
    layout = torch.channels_last
    return type(batch)(*(image.to(device=target, memory_format=layout) for image in images))


def _save(run: _Run, learner: Learner[Any], *, folder: Path, kind: str, identity: str) -> None:
    # Write the curve first: after a kill in between, resumed training overwrites its last lines.
    output.write_file(folder / CURVE, _csv(run.curve).encode(), force=True)
    content = learner.state() | {
        "identity": identity,
        "averaged": run.averaged.state_dict(),
        "step": run.step,
        "curve": run.curve,
    }
    checkpoint.save(folder / CHECKPOINT, kind, content)


def _resume(run: _Run, learner: Learner[Any], content: dict[str, Any], identity: str) -> None:
    if content["identity"] != identity:
        rule = "must belong to this training, with the same scenes, settings and seed"
        remedy = "Choose an empty folder."
        raise refuse("checkpoint", rule, content["identity"], remedy)
    checkpoint.restore(learner.networks, content["networks"])
    checkpoint.restore(run.averaged, content["averaged"])
    states = content["optimizers"]
    if len(states) != len(learner.optimizers):
        rule = f"must have {len(learner.optimizers)} optimizers"
        raise refuse("checkpoint", rule, len(states), "Choose an empty folder.")
    for optimizer, state in zip(learner.optimizers, states, strict=True):
        checkpoint.restore_optimizer(optimizer, state)
    for name in ("step", "curve"):
        setattr(run, name, content[name])


def _csv(curve: Sequence[dict[str, float]]) -> str:
    lines = [",".join(curve[0])]
    lines += [",".join(f"{value:.9g}" for value in row.values()) for row in curve]
    return "\n".join(lines) + "\n"
