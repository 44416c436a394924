"""Small U-Nets that predict logits of no depth: from depth alone, and as correction of physics.

Source of the network: A supervised approach to predicting noise in depth images, sec. III-B.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from scipy.special import expit
from torch import Tensor, nn
from torch.nn import functional

from starling.learning.data.example import Example, Image, Mask
from starling.learning.data.physics import physics_probability
from starling.learning.networks import checkpoint, samples
from starling.learning.networks.channels import (
    LOGIT_SCALE,
    ODD,
    channels,
    names,
    require_physics,
    uninformative,
)
from starling.learning.networks.device import initialised, mixed_precision, run_network
from starling.learning.networks.resampling import at_training_scale
from starling.learning.networks.samples import Batch
from starling.learning.networks.training import (
    STEEPEST,
    Draw,
    Learner,
    TrainingSettings,
    decaying_adam,
    descend,
    mean,
    one_cycle,
    train,
)
from starling.learning.networks.unet import UNet
from starling.sim.console import progress
from starling.sim.on_demand import OnDemand

_DEFAULTS = TrainingSettings()


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
            logit = self.networks["holes"](batch.inputs).float()
            losses = functional.binary_cross_entropy_with_logits(
                logit, batch.target, reduction="none"
            )
            loss = mean(losses, batch.counted)
        descend(self.optimizers[0], loss, steepest=STEEPEST)
        return {"log_loss": loss.item()}


@dataclass(frozen=True, slots=True, eq=False)
class NetworkPredictor:
    """A trained network that predicts logits."""

    network: nn.Module
    with_reflectance: bool
    shape: tuple[int, int]  # (h, w) of the training images.

    def probability(self, example: Example) -> Image:
        """Run the network, (h, w), in pixels of the training images.

        Raises:
            InputError: if no reference depth is known, or its reflectance is required but missing.
        """

        def logit(seen: Example) -> Image:
            inputs = channels(seen, with_reflectance=self.with_reflectance, with_physics=False)
            return run_network(self.network, inputs)

        return expit(at_training_scale(example, self.shape, logit))


class LogitCorrection(nn.Module):
    """logit = scale x physics' logit + f(all channels), initially with scale 1 and f = 0.

    A scale below 1 corrects overconfident physics.
    """

    def __init__(self, inputs: int, logit_channel: int) -> None:
        super().__init__()
        self.logit_channel = logit_channel
        self.scale = nn.Parameter(torch.ones(1))
        self.unet = UNet(inputs)

    def correction(self, inputs: Tensor) -> Tensor:
        """Return the correction of the physics' logit (b, 1, h, w); exactly 0 before training."""
        return (self.scale - 1) * self._logit(inputs) + self.unet(inputs)

    def forward(self, inputs: Tensor) -> Tensor:
        return self._logit(inputs) + self.correction(inputs)

    def _logit(self, inputs: Tensor) -> Tensor:
        return inputs[:, self.logit_channel, None] / LOGIT_SCALE


@dataclass(frozen=True, slots=True, eq=False)
class HybridPredictor:
    """Physics with its trained correction."""

    network: LogitCorrection
    with_reflectance: bool
    shape: tuple[int, int]  # (h, w) of the training images.

    def probability(self, example: Example) -> Image:
        """Correct the simulated probability, (h, w), in pixels of the training images.

        Raises:
            InputError: if the example has no physics, no reference depth is known, or its
                reflectance is required but missing.
        """

        def correction(seen: Example) -> Image:
            inputs = channels(seen, with_reflectance=self.with_reflectance, with_physics=True)
            return run_network(self.network.correction, inputs)

        physics = require_physics(example)
        change = at_training_scale(example, self.shape, correction)
        return corrected(physics_probability(physics), change)


def corrected(probability: Image, correction: Image) -> Image:
    """sigmoid(logit(p) + correction), in terms of odds: p / (p + (1 - p) exp(-correction)).

    A correction of 0 returns `probability` bit for bit: in binary arithmetic p + (1 - p) rounds to
    exactly 1 for every p in [0, 1].
    """
    with np.errstate(over="ignore"):  # Where exp is infinite, the probability is 0.
        against = (1 - probability) * np.exp(-correction)
    return (probability / (probability + against)).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Network:
    """A U-Net on the reference depth alone, with its inputs and settings."""

    with_reflectance: bool = False  # The network also uses the smoothed infrared image.
    settings: TrainingSettings = _DEFAULTS
    stem: ClassVar[str] = "network"  # Name without reflectance.
    with_physics: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """Name of the method and of its file."""
        return f"{self.stem}_reflectance" if self.with_reflectance else self.stem

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> NetworkPredictor | HybridPredictor:
        """Train, or continue from the folder's checkpoint, and save the weights there.

        Raises:
            InputError: see `starling.learning.networks.samples.collect` and
                `starling.learning.networks.training.train`; and `checkpoint.load_network` for
                initial weights.
        """
        kinds = {"with_reflectance": self.with_reflectance, "with_physics": self.with_physics}
        odd = tuple(self._channels.index(name) for name in ODD)
        scenes = samples.collect(
            examples, partial(channels, **kinds), odd=odd, target=_ndp, folder=folder, track=track
        )
        share = samples.share(scenes)
        if self.with_physics:
            hideable = uninformative(share, with_reflectance=self.with_reflectance)
            scenes = OnDemand(scenes, partial(dataclasses.replace, hideable=hideable))
        network = initialised(partial(self.untrained, share), seed)
        if self.settings.start is not None:
            checkpoint.load_network(self.settings.start, self.name, network, self._channels)
            network.requires_grad_(True).train()
        trained = train(
            HoleLearner(network, self.settings),
            samples.Crops(samples=scenes, settings=self.settings, seed=seed),
            self.settings,
            kind=f"{self.name} training",
            folder=folder,
            track=track,
        )["holes"]
        shape = examples[0].info.shape
        checkpoint.save_network(folder, self.name, trained, self._channels, shape)
        return self._predictor(trained, shape)

    def load(self, folder: Path) -> NetworkPredictor | HybridPredictor:
        """Load the weights that `fit` of the same method saved.

        Raises:
            InputError: see `starling.learning.networks.checkpoint.load_network`.
        """
        network = self.untrained()
        shape = checkpoint.load_network(folder, self.name, network, self._channels)
        return self._predictor(network, shape)

    def untrained(self, share: float = 0.5) -> nn.Module:
        """Build the untrained network, which predicts the share of holes at every pixel."""
        network = UNet(len(self._channels))
        network.start_at(math.log(share / (1 - share)))
        return network

    def _predictor(
        self, network: nn.Module, shape: tuple[int, int]
    ) -> NetworkPredictor | HybridPredictor:
        return NetworkPredictor(network, self.with_reflectance, shape)

    @property
    def _channels(self) -> tuple[str, ...]:
        return names(with_reflectance=self.with_reflectance, with_physics=self.with_physics)


@dataclass(frozen=True, kw_only=True, slots=True)
class Hybrid(Network):
    """A U-Net that corrects the simulator's logit of no depth."""

    stem: ClassVar[str] = "hybrid"
    with_physics: ClassVar[bool] = True

    def untrained(self, share: float = 0.5) -> LogitCorrection:
        """Build the untrained network, which does not change physics."""
        del share
        return LogitCorrection(len(self._channels), self._channels.index("logit"))

    def _predictor(self, network: nn.Module, shape: tuple[int, int]) -> HybridPredictor:
        assert isinstance(network, LogitCorrection)
        return HybridPredictor(network, self.with_reflectance, shape)


def _ndp(example: Example) -> Mask:
    return np.asarray(example.ndp)
