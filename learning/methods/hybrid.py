"""What physics misses: a U-Net that corrects the simulator's logit of no depth."""

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
from starling.learning.networks.training.settings import Settings
from starling.learning.networks.unet import UNet
from starling.sim.console import progress

_DEFAULTS = Settings()


class LogitCorrection(nn.Module):
    """logit = scale x physics' logit + f(all channels), with scale 1 and f 0 at first.

    A scale below 1 says that the physics is too sure of itself.
    """

    def __init__(self, inputs: int, logit_channel: int) -> None:
        super().__init__()
        self.logit_channel = logit_channel
        self.scale = nn.Parameter(torch.ones(1))
        self.unet = UNet(inputs)

    def correction(self, seen: Tensor) -> Tensor:
        """What is added to the physics' logit (b, 1, h, w); exactly 0 before learning."""
        return (self.scale - 1) * self._logit(seen) + self.unet(seen)

    def forward(self, seen: Tensor) -> Tensor:
        return self._logit(seen) + self.correction(seen)

    def _logit(self, seen: Tensor) -> Tensor:
        return seen[:, self.logit_channel, None] / LOGIT_SCALE


@dataclass(frozen=True, slots=True, eq=False)
class HybridPredictor:
    """Physics and what corrects it."""

    network: LogitCorrection
    with_reflectance: bool
    shape: tuple[int, int]  # (h, w) learnt from.

    def probability(self, example: Example) -> Image:
        """Correct what physics tells, (h, w).

        Raises:
            InputError: if the example has no physics or another size than was learnt from, nothing
                is known of its reference, or its reflectance is missing and needed.
        """
        check_same_size(example, self.shape)
        seen = channels(example, with_reflectance=self.with_reflectance, with_physics=True)
        correction = inference.apply(self.network.correction, seen)
        assert example.physics is not None  # `channels` refuses.
        return corrected(physics_probability(example.physics), correction)


def corrected(probability: Image, correction: Image) -> Image:
    """sigmoid(logit(p) + correction), written in odds: p / (p + (1 - p) exp(-correction)).

    Where the correction is 0 it is `probability` bit for bit: in binary arithmetic p + (1 - p)
    rounds to exactly 1 for every p in [0, 1].
    """
    with np.errstate(over="ignore"):  # exp = infinity: the probability is 0.
        against = (1 - probability) * np.exp(-correction)
    return (probability / (probability + against)).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Hybrid:
    """What it sees and how it learns."""

    with_reflectance: bool = False  # The network too sees the smoothed infrared image.
    settings: Settings = _DEFAULTS

    @property
    def name(self) -> str:
        """What it is called, and its file."""
        return "hybrid_reflectance" if self.with_reflectance else "hybrid"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> HybridPredictor:
        """Learn, or go on with what lies in the folder, and leave the weights there.

        Raises:
            InputError: as `starling.learning.networks.training.samples.collect` and `starling.learning.networks.training.loop.train`.
        """
        network = fit_hole_network(
            examples,
            lambda _share: self.unlearnt(),
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
        """Read what `fit` of the same kind has left in its folder.

        Raises:
            InputError: as `starling.learning.networks.training.weights.load`.
        """
        network = self.unlearnt()
        shape = weights.load(folder, self.name, network, self._seen)
        return HybridPredictor(network, self.with_reflectance, shape)

    def unlearnt(self) -> LogitCorrection:
        """The network before learning, which leaves the physics as it is."""
        return LogitCorrection(len(self._seen), self._seen.index("logit"))

    @property
    def _seen(self) -> tuple[str, ...]:
        return names(with_reflectance=self.with_reflectance, with_physics=True)
