"""A small U-Net on the reference depth alone.

Source: A supervised approach to predicting noise in depth images, sec. III-B.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.special import expit
from torch import nn

from starling.learning.data.example import Example, Image
from starling.learning.networks import inference
from starling.learning.networks.training import weights
from starling.learning.networks.training.channels import channels, names
from starling.learning.networks.training.hole_network import fit_hole_network
from starling.learning.networks.training.samples import check_same_size
from starling.learning.networks.training.settings import TrainingSettings
from starling.learning.networks.unet import UNet
from starling.sim.console import progress

_DEFAULTS = TrainingSettings()


@dataclass(frozen=True, slots=True, eq=False)
class NetworkPredictor:
    """A trained network that predicts logits."""

    network: nn.Module
    with_reflectance: bool
    shape: tuple[int, int]  # (h, w) of the training images.

    def probability(self, example: Example) -> Image:
        """Run the network, (h, w).

        Raises:
            InputError: if the example has another size than the training images, no reference depth
                is known, or its reflectance is required but missing.
        """
        check_same_size(example, self.shape)
        inputs = channels(example, with_reflectance=self.with_reflectance, with_physics=False)
        return expit(inference.apply(self.network, inputs))


@dataclass(frozen=True, kw_only=True, slots=True)
class Network:
    """Network with its inputs and settings."""

    with_reflectance: bool = False  # The network also uses the smoothed infrared image.
    settings: TrainingSettings = _DEFAULTS

    @property
    def name(self) -> str:
        """Name of the method and of its file."""
        return "network_reflectance" if self.with_reflectance else "network"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> NetworkPredictor:
        """Train, or continue from the folder's checkpoint, and save the weights there.

        Raises:
            InputError: see `starling.learning.networks.training.samples.collect` and
                `starling.learning.networks.training.loop.train`.
        """
        network = fit_hole_network(
            examples,
            self.untrained,
            self.settings,
            name=self.name,
            with_reflectance=self.with_reflectance,
            with_physics=False,
            folder=folder,
            seed=seed,
            track=track,
        )
        return NetworkPredictor(network, self.with_reflectance, examples[0].info.shape)

    def load(self, folder: Path) -> NetworkPredictor:
        """Load the weights that `fit` of the same method saved.

        Raises:
            InputError: see `starling.learning.networks.training.weights.load`.
        """
        network = self.untrained()
        shape = weights.load(folder, self.name, network, self._channels)
        return NetworkPredictor(network, self.with_reflectance, shape)

    def untrained(self, share: float = 0.5) -> UNet:
        """Build the untrained network, which predicts the share of holes at every pixel."""
        network = UNet(len(self._channels))
        network.start_at(math.log(share / (1 - share)))
        return network

    @property
    def _channels(self) -> tuple[str, ...]:
        return names(with_reflectance=self.with_reflectance, with_physics=False)
