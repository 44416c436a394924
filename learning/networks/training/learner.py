"""Networks in training, their optimisers, and one step of each kind of training."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.networks.training.samples import Batch
from starling.learning.networks.training.settings import Schedule, TrainingSettings

_Batch = TypeVar("_Batch")
_Network = TypeVar("_Network", bound=nn.Module)
Draw = Callable[[str], _Batch]  # Draws the batch of one part of a step, by name.

_WARM_UP = 0.1  # Share of the steps in which the learning rate rises.
STEEPEST = 1.0  # Gradients are clipped to this length.


def device() -> torch.device:
    """Return the GPU if there is one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def mixed_precision(target: torch.device) -> torch.autocast:
    """Use 16-bit arithmetic on a GPU, which is sufficient for training; no effect elsewhere."""
    return torch.autocast(target.type, torch.bfloat16, enabled=target.type == "cuda")


def initialised(build: Callable[[], _Network], seed: int) -> _Network:
    """Build a network with initial weights from a seed, without changing torch's random state."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return to_device(build())


def to_device(network: _Network) -> _Network:
    """Move a network to its device, in the memory layout that is fast for convolutions."""
    network = network.to(device())
    return nn.utils.convert_conv2d_weight_memory_format(network, torch.channels_last)


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


class HoleLearner(Learner[Batch]):
    """Trains logits of no depth, `networks["holes"]`, by log loss.

    Every counted pixel has the same weight, although holes are rare. Log loss is a proper scoring
    rule (Gneiting and Raftery, JASA 2007) with its minimum at the true probabilities, which class
    weights would shift. Starting the bias at the logit of the share of holes avoids a slow start.
    """

    def __init__(self, network: nn.Module, settings: TrainingSettings) -> None:
        self.settings = settings
        super().__init__({"holes": network}, [decaying_adam(network, settings.weight_decay)])

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        self.set_rate(one_cycle(step, self.settings))
        batch = draw("crops")
        with mixed_precision(batch.inputs.device):
            loss = log_loss(self.networks, batch)
        descend(self.optimizers[0], loss, steepest=STEEPEST)
        return {"log_loss": loss.item()}


def log_loss(networks: nn.ModuleDict, batch: Batch) -> Tensor:
    """Return the mean log loss () of `networks["holes"]` over counted pixels."""
    logit = networks["holes"](batch.inputs).float()
    loss = functional.binary_cross_entropy_with_logits(logit, batch.target, reduction="none")
    return mean(loss, batch.counted)


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
