"""Hybrid: a U-Net that corrects the simulator's logit of no depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from starling.learning.data.example import Example, Image
from starling.learning.data.physics_probability import physics_probability
from starling.learning.networks import inference
from starling.learning.networks.training import weights
from starling.learning.networks.training.channels import LOGIT_SCALE, channels, names
from starling.learning.networks.training.hole_network import fit_hole_network
from starling.learning.networks.training.samples import check_same_size
from starling.learning.networks.training.settings import TrainingSettings
from starling.learning.networks.unet import UNet
from starling.sim.console import progress

_DEFAULTS = TrainingSettings()


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
        """Correct the simulated probability, (h, w).

        Raises:
            InputError: if the example has no physics or another size than the training images; no
                reference depth is known; its reflectance is required but missing.
        """
        check_same_size(example, self.shape)
        inputs = channels(example, with_reflectance=self.with_reflectance, with_physics=True)
        correction = inference.apply(self.network.correction, inputs)
        assert example.physics is not None  # Checked by `channels`.
        return corrected(physics_probability(example.physics), correction)


def corrected(probability: Image, correction: Image) -> Image:
    """sigmoid(logit(p) + correction), in terms of odds: p / (p + (1 - p) exp(-correction)).

    A correction of 0 returns `probability` bit for bit: in binary arithmetic p + (1 - p) rounds to
    exactly 1 for every p in [0, 1].
    """
    with np.errstate(over="ignore"):  # Where exp is infinite, the probability is 0.
        against = (1 - probability) * np.exp(-correction)
    return (probability / (probability + against)).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Hybrid:
    """Hybrid with its inputs and settings."""

    with_reflectance: bool = False  # The network also uses the smoothed infrared image.
    settings: TrainingSettings = _DEFAULTS

    @property
    def name(self) -> str:
        """Name of the method and of its file."""
        return "hybrid_reflectance" if self.with_reflectance else "hybrid"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> HybridPredictor:
        """Train, or continue from the folder's checkpoint, and save the weights there.

        Raises:
            InputError: see `starling.learning.networks.training.samples.collect` and
                `starling.learning.networks.training.loop.train`.
        """
        network = fit_hole_network(
            examples,
            lambda _share: self.untrained(),
            self.settings,
            name=self.name,
            with_reflectance=self.with_reflectance,
            with_physics=True,
            folder=folder,
            seed=seed,
            track=track,
        )
        assert isinstance(network, LogitCorrection)
        return HybridPredictor(network, self.with_reflectance, examples[0].info.shape)

    def load(self, folder: Path) -> HybridPredictor:
        """Load the weights that `fit` of the same method saved.

        Raises:
            InputError: see `starling.learning.networks.training.weights.load`.
        """
        network = self.untrained()
        shape = weights.load(folder, self.name, network, self._channels)
        return HybridPredictor(network, self.with_reflectance, shape)

    def untrained(self) -> LogitCorrection:
        """Build the untrained network, which does not change physics."""
        return LogitCorrection(len(self._channels), self._channels.index("logit"))

    @property
    def _channels(self) -> tuple[str, ...]:
        return names(with_reflectance=self.with_reflectance, with_physics=True)
