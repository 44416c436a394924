"""pix2pix, the seed's first baseline: paired translation from reference depth to device depth.

Source: Isola et al., Image-to-image translation with conditional adversarial networks, CVPR 2017.
What is different is what rare holes ask for. The error is squared, not taken absolute: the absolute
one is least at the median, which where fewer than half of the pixels alike are holes is depth; so
trained it learnt nothing of a D415's holes, 2 % of the pixels (AUC 0.51). And the generator sees
what our network sees, and keeps or loses each depth instead of drawing it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from starling.learning.data.example import Example, Image
from starling.learning.networks.training import channels
from starling.learning.networks.training.learner import (
    STEEPEST,
    Draw,
    Learner,
    descend,
    initialised,
    mean,
    one_cycle,
    sparing,
)
from starling.learning.networks.training.samples import Batch
from starling.learning.networks.training.settings import Settings
from starling.learning.networks.training.translation import (
    PatchDiscriminator,
    Sight,
    TranslationPredictor,
    adversary,
    depth_image,
    fit_translation,
    judged,
    load_translation,
)
from starling.learning.networks.unet import UNet
from starling.sim.console import progress

SQUARE_WEIGHT = 100.0  # Against the discriminator's verdict (Isola et al., sec. 3.3).
SETTINGS = Settings(steps=1000, batch=4, rate=1e-3)
_TOLD_RATE = 0.2  # Of the discriminator's learning rate over the generator's.
_KEPT = 4.0  # Logit of a depth that is kept, before anything is learnt.


def _see(example: Example) -> Image:
    seen = channels.channels(example, with_reflectance=False, with_physics=False)
    return np.concatenate([depth_image(example), seen])


_GEOMETRY = channels.names(with_reflectance=False, with_physics=False)
SIGHT = Sight(
    names=("depth", *_GEOMETRY),
    odd=tuple(1 + _GEOMETRY.index(name) for name in channels.ODD),
    see=_see,
)


class Keeper(nn.Module):
    """Depth image and geometry (b, c, h, w) to a depth image (b, 1, h, w) that has lost some."""

    def __init__(self) -> None:
        super().__init__()
        self.unet = UNet(len(_GEOMETRY))
        self.unet.start_at(_KEPT)

    def forward(self, seen: Tensor) -> Tensor:
        return seen[:, :1] * torch.sigmoid(self.unet(seen[:, 1:]))


class Pix2PixLearner(Learner[Batch]):
    """A generator, and a discriminator that sees what it was given and what it made of it."""

    def __init__(self, generator: nn.Module, discriminator: nn.Module, settings: Settings) -> None:
        networks = {"generator": generator, "discriminator": discriminator}
        super().__init__(networks, [adversary(generator), adversary(discriminator)])
        self.settings = settings

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        rate = one_cycle(step, self.settings)
        self.set_rates(rate, _TOLD_RATE * rate)
        batch = draw("crops")
        depth, discriminator = batch.seen[:, :1], self.networks["discriminator"]
        with sparing(batch.seen.device):
            made = self.networks["generator"](batch.seen)
            apart = mean((made - batch.target).float() ** 2, batch.counted)
            fooled = judged(discriminator(torch.cat([depth, made], 1)), True)
        descend(self.optimizers[0], SQUARE_WEIGHT * apart + fooled, steepest=STEEPEST)
        with sparing(batch.seen.device):
            real = judged(discriminator(torch.cat([depth, batch.target], 1)), True)
            false = judged(discriminator(torch.cat([depth, made.detach()], 1)), False)
        told = (real + false) / 2
        descend(self.optimizers[1], told)
        return {"square": apart.item(), "fooled": fooled.item(), "told": told.item()}


@dataclass(frozen=True, kw_only=True, slots=True)
class Pix2Pix:
    """How it learns."""

    name: ClassVar[str] = "pix2pix"
    settings: Settings = SETTINGS

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> TranslationPredictor:
        """Learn, or go on with what lies in the folder, and leave the weights there.

        Raises:
            InputError: as `starling.learning.networks.training.translation.fit_translation`.
        """
        generator = initialised(Keeper, seed)
        discriminator = initialised(partial(PatchDiscriminator, 2), seed)
        return fit_translation(
            examples,
            Pix2PixLearner(generator, discriminator, self.settings),
            "generator",
            self.settings,
            sight=SIGHT,
            name=self.name,
            folder=folder,
            seed=seed,
            track=track,
        )

    def load(self, folder: Path) -> TranslationPredictor:
        """Read what `fit` has left in its folder.

        Raises:
            InputError: as `starling.learning.networks.training.weights.load`.
        """
        return load_translation(folder, self.name, Keeper(), SIGHT)
