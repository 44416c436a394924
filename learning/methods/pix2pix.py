"""pix2pix, the seed's first baseline: paired translation from reference depth to device depth.

Source: Isola et al., Image-to-image translation with conditional adversarial networks, CVPR 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import torch
from torch import nn

from learning.example import Example
from learning.training.learner import Draw, Learner, initialised, mean, sparing
from learning.training.settings import Settings
from learning.training.translation import (
    ADVERSARIAL,
    PatchDiscriminator,
    TranslationPredictor,
    Translator,
    adversary,
    descend,
    fit_translation,
    judged,
    linear_decay,
    load_translation,
)
from sim import progress

L1_WEIGHT = 100.0  # Against the discriminator's verdict (Isola et al., sec. 3.3).


class Pix2PixLearner(Learner):
    """A generator, and a discriminator that sees what it was given and what it made of it."""

    def __init__(self, generator: nn.Module, discriminator: nn.Module, settings: Settings) -> None:
        networks = {"generator": generator, "discriminator": discriminator}
        super().__init__(networks, [adversary(generator), adversary(discriminator)])
        self.settings = settings

    def update(self, draw: Draw, step: int) -> dict[str, float]:
        self.set_rate(linear_decay(step, self.settings))
        batch = draw("crops")
        discriminator = self.networks["discriminator"]
        with sparing(batch.seen.device):
            made = self.networks["generator"](batch.seen)
            apart = (mean((made - batch.target).abs(), batch.counted)).float()
            fooled = judged(discriminator(torch.cat([batch.seen, made], 1)), True)
        descend(self.optimizers[0], L1_WEIGHT * apart + fooled)
        with sparing(batch.seen.device):
            real = judged(discriminator(torch.cat([batch.seen, batch.target], 1)), True)
            false = judged(discriminator(torch.cat([batch.seen, made.detach()], 1)), False)
        told = (real + false) / 2
        descend(self.optimizers[1], told)
        return {"l1": apart.item(), "fooled": fooled.item(), "told": told.item()}


@dataclass(frozen=True, kw_only=True, slots=True)
class Pix2Pix:
    """How it learns."""

    name: ClassVar[str] = "pix2pix"
    settings: Settings = ADVERSARIAL

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        tell: progress.Progress = progress.silent,
    ) -> TranslationPredictor:
        """Learn, or go on with what lies in the folder, and leave the weights there.

        Raises:
            InputError: as `learning.training.translation.fit_translation`.
        """
        generator = initialised(Translator, seed)
        discriminator = initialised(partial(PatchDiscriminator, 2), seed)
        return fit_translation(
            examples,
            Pix2PixLearner(generator, discriminator, self.settings),
            "generator",
            self.settings,
            name=self.name,
            folder=folder,
            seed=seed,
            tell=tell,
        )

    def load(self, folder: Path) -> TranslationPredictor:
        """Read what `fit` has left in its folder.

        Raises:
            InputError: as `learning.training.weights.load`.
        """
        return load_translation(folder, self.name)
