"""What learns: networks, their optimizers, and one step of each kind of training."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.networks.training.samples import Batch
from starling.learning.networks.training.settings import Schedule, Settings

_Some = TypeVar("_Some")
_Network = TypeVar("_Network", bound=nn.Module)
Draw = Callable[[str], _Some]  # Gives what a part of this step learns from.

_WARM_UP = 0.1  # Share of the steps in which the rate rises.
STEEPEST = 1.0  # Gradients longer than this are cut to it.


def device() -> torch.device:
    """The GPU where there is one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def sparing(where: torch.device) -> torch.autocast:
    """16-bit arithmetic on a GPU, which loses nothing that training needs; none elsewhere."""
    return torch.autocast(where.type, torch.bfloat16, enabled=where.type == "cuda")


def initialised(build: Callable[[], _Network], seed: int) -> _Network:
    """Build a network whose first weights the seed fixes, and leave torch's own draws alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return placed(build())


def placed(network: _Network) -> _Network:
    """Put a network where it is to run, with the memory layout that convolutions like."""
    network = network.to(device())
    return nn.utils.convert_conv2d_weight_memory_format(network, torch.channels_last)


class Learner(ABC, Generic[_Some]):
    """Networks under training; everything a restart needs is in them and the optimizers."""

    def __init__(self, networks: Mapping[str, nn.Module], optimizers: list[optim.Optimizer]):
        self.networks = nn.ModuleDict(dict(networks))
        self.optimizers = optimizers

    @abstractmethod
    def update(self, draw: Draw[_Some], step: int) -> dict[str, float]:
        """Take a step and name the losses before it."""

    def state(self) -> dict[str, Any]:
        """Everything that changes in training."""
        return {
            "networks": self.networks.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
        }

    def set_rate(self, rate: float) -> None:
        """Give all optimizers one learning rate."""
        self.set_rates(*[rate] * len(self.optimizers))

    def set_rates(self, *rates: float) -> None:
        """Give each optimizer its learning rate."""
        for optimizer, rate in zip(self.optimizers, rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = rate


def decaying(network: nn.Module, decay: float) -> optim.AdamW:
    """Optimizer that lets weights decay, but no biases."""
    parameters = list(network.parameters())
    groups = [
        {"params": [p for p in parameters if p.ndim > 1]},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]
    return optim.AdamW(groups, weight_decay=decay)


def descend(optimizer: optim.Optimizer, loss: Tensor, *, steepest: float = math.inf) -> None:
    """One step down the loss; gradients longer than `steepest` are cut to it."""
    optimizer.zero_grad()
    loss.backward()
    moved = [one for group in optimizer.param_groups for one in group["params"]]
    nn.utils.clip_grad_norm_(moved, steepest)
    optimizer.step()


class HoleLearner(Learner[Batch]):
    """Learns logits of no depth, `networks["holes"]`, by log loss.

    Every counted pixel weighs the same, however rare holes are: log loss is a proper scoring rule
    (Gneiting and Raftery, JASA 2007), least for the true probabilities, and weighting a class up
    would shift them. What rarity costs, a slow start, the first bias at the share's logit saves.
    """

    def __init__(self, network: nn.Module, settings: Settings) -> None:
        self.settings = settings
        super().__init__({"holes": network}, [decaying(network, settings.weight_decay)])

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        self.set_rate(one_cycle(step, self.settings))
        batch = draw("crops")
        with sparing(batch.seen.device):
            loss = log_loss(self.networks, batch)
        descend(self.optimizers[0], loss, steepest=STEEPEST)
        return {"log_loss": loss.item()}


def log_loss(networks: nn.ModuleDict, batch: Batch) -> Tensor:
    """Mean log loss () of `networks["holes"]` over the counted pixels."""
    logit = networks["holes"](batch.seen).float()
    loss = functional.binary_cross_entropy_with_logits(logit, batch.target, reduction="none")
    return mean(loss, batch.counted)


def mean(values: Tensor, counted: Tensor) -> Tensor:
    """Mean of the counted pixels; 0 where none counts."""
    return (values * counted).sum() / counted.sum().clamp(min=1)


def one_cycle(step: int, settings: Schedule) -> float:
    """Learning rate: a straight rise, then half a cosine to 0 (Smith, arXiv 1803.09820)."""
    rise = max(1.0, _WARM_UP * settings.steps)
    if step < rise:
        return settings.rate * (step + 1) / (rise + 1)
    part = (step - rise) / max(1.0, settings.steps - rise)
    return settings.rate * 0.5 * (1 + math.cos(math.pi * part))
