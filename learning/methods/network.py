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
from starling.learning.networks.training.settings import Settings
from starling.learning.networks.unet import UNet
from starling.sim.console import progress

_DEFAULTS = Settings()


@dataclass(frozen=True, slots=True, eq=False)
class NetworkPredictor:
    """A network that gives logits."""

    network: nn.Module
    with_reflectance: bool
    shape: tuple[int, int]  # (h, w) learnt from.

    def probability(self, example: Example) -> Image:
        """Run the network, (h, w).

        Raises:
            InputError: if the example has another size than was learnt from, nothing is known of
                its reference, or its reflectance is missing and needed.
        """
        check_same_size(example, self.shape)
        seen = channels(example, with_reflectance=self.with_reflectance, with_physics=False)
        return expit(inference.apply(self.network, seen))


@dataclass(frozen=True, kw_only=True, slots=True)
class Network:
    """What it sees and how it learns."""

    with_reflectance: bool = False  # Sees the smoothed infrared image as well.
    settings: Settings = _DEFAULTS

    @property
    def name(self) -> str:
        """What it is called, and its file."""
        return "network_reflectance" if self.with_reflectance else "network"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> NetworkPredictor:
        """Learn, or go on with what lies in the folder, and leave the weights there.

        Raises:
            InputError: as `starling.learning.networks.training.samples.collect` and `starling.learning.networks.training.loop.train`.
        """
        network = fit_hole_network(
            examples,
            self.unlearnt,
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
        """Read what `fit` of the same kind has left in its folder.

        Raises:
            InputError: as `starling.learning.networks.training.weights.load`.
        """
        network = self.unlearnt()
        shape = weights.load(folder, self.name, network, self._seen)
        return NetworkPredictor(network, self.with_reflectance, shape)

    def unlearnt(self, share: float = 0.5) -> UNet:
        """Give every pixel the share of holes at first: that much need not be learnt."""
        network = UNet(len(self._seen))
        network.start_at(math.log(share / (1 - share)))
        return network

    @property
    def _seen(self) -> tuple[str, ...]:
        return names(with_reflectance=self.with_reflectance, with_physics=False)
