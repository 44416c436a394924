"""pix2pix, the seed paper's first baseline: paired translation from reference to device depth.

Source: Isola et al., Image-to-image translation with conditional adversarial networks, CVPR 2017.

Two changes account for rare holes. The error is squared, not absolute. The absolute error is least
at the median, which is depth where fewer than half of similar pixels are holes. Trained with it,
the network learnt none of a D415's holes, 2 % of the pixels (AUC 0.51). The generator also has the
inputs of our network, and keeps or removes each depth instead of drawing it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from starling.learning.data.example import Example, Image
from starling.learning.methods.translation import (
    PatchDiscriminator,
    Translation,
    TranslatorInput,
    adversary,
    depth_image,
    least_squares_loss,
)
from starling.learning.networks import channels
from starling.learning.networks.device import initialised, mixed_precision
from starling.learning.networks.samples import Batch
from starling.learning.networks.training import (
    STEEPEST,
    Draw,
    Learner,
    TrainingSettings,
    descend,
    mean,
    one_cycle,
)
from starling.learning.networks.unet import UNet

SQUARE_WEIGHT = 100.0  # Relative to the discriminator's loss (Isola et al., sec. 3.3).
SETTINGS = TrainingSettings(steps=1000, batch=4, rate=1e-3)
_DISCRIMINATOR_RATE = 0.2  # Learning rate of the discriminator over that of the generator.
_KEPT = 4.0  # Logit of keeping a depth before training.


def _input_channels(example: Example) -> Image:
    inputs = channels.channels(example, with_reflectance=False, with_physics=False)
    return np.concatenate([depth_image(example), inputs])


_GEOMETRY = channels.names(with_reflectance=False, with_physics=False)
INPUTS = TranslatorInput(
    names=("depth", *_GEOMETRY),
    odd=tuple(1 + _GEOMETRY.index(name) for name in channels.ODD),
    see=_input_channels,
)


class Keeper(nn.Module):
    """Maps depth image and geometry (b, c, h, w) to a depth image (b, 1, h, w) with holes."""

    def __init__(self) -> None:
        super().__init__()
        self.unet = UNet(len(_GEOMETRY))
        self.unet.start_at(_KEPT)

    def forward(self, inputs: Tensor) -> Tensor:
        return inputs[:, :1] * torch.sigmoid(self.unet(inputs[:, 1:]))


class Pix2PixLearner(Learner[Batch]):
    """A generator, and a discriminator of pairs of its input and output."""

    def __init__(
        self, generator: nn.Module, discriminator: nn.Module, settings: TrainingSettings
    ) -> None:
        networks = {"generator": generator, "discriminator": discriminator}
        super().__init__(networks, [adversary(generator), adversary(discriminator)])
        self.settings = settings

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        rate = one_cycle(step, self.settings)
        self.set_rates(rate, _DISCRIMINATOR_RATE * rate)
        batch = draw("crops")
        depth, discriminator = batch.inputs[:, :1], self.networks["discriminator"]
        with mixed_precision(batch.inputs.device):
            generated = self.networks["generator"](batch.inputs)
            square_error = mean((generated - batch.target).float() ** 2, batch.counted)
            fooled = least_squares_loss(discriminator(torch.cat([depth, generated], 1)), True)
        descend(self.optimizers[0], SQUARE_WEIGHT * square_error + fooled, steepest=STEEPEST)
        with mixed_precision(batch.inputs.device):
            real = least_squares_loss(discriminator(torch.cat([depth, batch.target], 1)), True)
            false = least_squares_loss(
                discriminator(torch.cat([depth, generated.detach()], 1)), False
            )
        discrimination = (real + false) / 2
        descend(self.optimizers[1], discrimination)
        return {
            "square": square_error.item(),
            "fooled": fooled.item(),
            "told": discrimination.item(),
        }


@dataclass(frozen=True, kw_only=True)
class Pix2Pix(Translation):
    """pix2pix with its settings."""

    name = "pix2pix"
    predicts = "generator"
    generator = Keeper
    inputs = INPUTS
    settings: TrainingSettings = SETTINGS

    def learner(self, seed: int) -> Pix2PixLearner:
        """Build the initial generator and discriminator."""
        discriminator = initialised(partial(PatchDiscriminator, 2), seed)
        return Pix2PixLearner(initialised(Keeper, seed), discriminator, self.settings)
