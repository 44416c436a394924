"""Depth images as image translation sees them: depth in, the same with the device's holes out."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.data.example import Example, Image, Mask
from starling.learning.networks import inference
from starling.learning.networks.training import samples as drawing
from starling.learning.networks.training import weights
from starling.learning.networks.training.channels import check_size
from starling.learning.networks.training.learner import Learner
from starling.learning.networks.training.loop import train
from starling.learning.networks.training.samples import Batch, Sample, check_same_size
from starling.learning.networks.training.settings import Settings
from starling.learning.networks.unet import UNet
from starling.patterns.errors import refuse
from starling.sim.console import progress

UNIT_M = 4.0  # Depth of value 1 in the images [m].
FARTHEST_M = 16.0  # Greater depths look like this one [m].
# The rate of Isola et al. and Zhu et al.; ten times higher the adversaries run away.
ADVERSARIAL = Settings(steps=3000, batch=4, rate=2e-4)
_BETAS = (0.5, 0.999)  # Likewise.


def adversary(*networks: nn.Module) -> optim.Optimizer:
    """What trains one side of the game."""
    return optim.Adam(itertools.chain(*(one.parameters() for one in networks)), betas=_BETAS)


class Translator(nn.Module):
    """Depth image (b, 1, h, w) to depth image; gives back what it gets before it has learnt."""

    def __init__(self) -> None:
        super().__init__()
        self.unet = UNet(1)

    def forward(self, depth: Tensor) -> Tensor:
        return depth + self.unet(depth)


class PatchDiscriminator(nn.Module):
    """Logits that patches of 46x46 pixels are real, (b, 1, h / 8, w / 8) or so.

    Source: Isola et al., Image-to-image translation with conditional adversarial networks,
    CVPR 2017, sec. 3.2.2, here a tenth as wide and without normalisation.
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        widths = (inputs, 16, 32, 64)
        self.layers = nn.ModuleList(
            nn.Conv2d(above, below, 4, stride=2, padding=1)
            for above, below in itertools.pairwise(widths)
        )
        self.last = nn.Conv2d(widths[-1], 1, 4, padding=2)

    def forward(self, image: Tensor) -> Tensor:
        for layer in self.layers:
            image = functional.leaky_relu(layer(image), 0.2)
        return self.last(image)


def judged(logit: Tensor, real: bool) -> Tensor:
    """Squared distance () from the verdict (Mao et al., Least squares GANs, ICCV 2017)."""
    return ((logit.float() - float(real)) ** 2).mean()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sight:
    """What a translator is given of a scene: the depth image first."""

    names: tuple[str, ...]
    odd: tuple[int, ...]  # Those that change sign upside down.
    see: Callable[[Example], Image]  # (c, h, w)


@dataclass(frozen=True, slots=True, eq=False)
class TranslationPredictor:
    """A translator; its answer is always the same, so its probabilities are no frequencies."""

    network: nn.Module
    shape: tuple[int, int]  # (h, w) learnt from.
    sight: Sight

    def depth_m(self, example: Example) -> Image:
        """The device's depth (h, w) [m] as the network draws it, below 0 and all.

        Raises:
            InputError: if the example has another size than was learnt from.
        """
        check_same_size(example, self.shape)
        return inference.apply(self.network, self.sight.see(example)) * np.float32(UNIT_M)

    def probability(self, example: Example) -> Image:
        """How far each depth has gone from the reference towards zero, (h, w), 0 to 1.

        From 0.5 on, nearer to zero than to the reference, the seed's yes or no says no depth. Where
        the reference is unknown there is nothing to lose: 1.

        Raises:
            InputError: if the example has another size than was learnt from.
        """
        drawn = self.depth_m(example)
        reference = depth_image(example)[0] * np.float32(UNIT_M)
        known = reference > 0
        kept = np.where(known, drawn, 0) / np.where(known, reference, 1)
        return (1 - np.clip(kept, 0, 1)).astype(np.float32)


def depth_image(example: Example) -> Image:
    """Reference depth (1, h, w), 1 at `UNIT_M`; 0 where unknown, as devices write it.

    Raises:
        InputError: if it has another size than the geometry says, or nothing is known.
    """
    check_size(example.info, "depth_m", example.depth_m)
    known = np.isfinite(example.depth_m)
    if not known.any():
        raise refuse("reference depth", "must be known somewhere", "no pixel", "Check truth.png.")
    depth = np.where(known, np.minimum(example.depth_m, FARTHEST_M), 0)
    return (depth / UNIT_M).astype(np.float32)[None]


DEPTH = Sight(names=("depth",), odd=(), see=depth_image)


def fit_translation(
    examples: Sequence[Example],
    learner: Learner[Batch],
    generator: str,
    settings: Settings,
    *,
    sight: Sight,
    name: str,
    folder: Path,
    seed: int,
    track: progress.Progress,
) -> TranslationPredictor:
    """Learn, or go on with what lies in the folder, and leave the generator's weights there.

    Args:
        examples: at least one; what should come out is the reference depth with the device's
            holes at 0.
        learner: the adversaries.
        generator: which of its networks is used in the end.
        settings: steps, batches and rates.
        sight: what the generator is given.
        name: the method's.
        folder: gets checkpoint, loss curve and weights.
        seed: fixes the crops.
        track: wraps loops that take long.

    Raises:
        InputError: as `starling.learning.networks.training.samples.collect` and `starling.learning.networks.training.loop.train`.
    """
    samples = _samples(examples, sight, track)
    kind = f"{name} training"
    crops = drawing.Crops(samples=samples, settings=settings, seed=seed)
    learnt = train(learner, crops, settings, kind=kind, folder=folder, track=track)
    shape = examples[0].info.shape
    weights.save(folder, name, learnt[generator], sight.names, shape)
    return TranslationPredictor(learnt[generator], shape, sight)


def load_translation(
    folder: Path, name: str, network: nn.Module, sight: Sight
) -> TranslationPredictor:
    """Read what `fit_translation` has left in a folder into a generator.

    Raises:
        InputError: as `starling.learning.networks.training.weights.load`.
    """
    shape = weights.load(folder, name, network, sight.names)
    return TranslationPredictor(network, shape, sight)


def _samples(examples: Sequence[Example], sight: Sight, track: progress.Progress) -> list[Sample]:
    def wanted(example: Example) -> Image:
        ndp: Mask = np.asarray(example.ndp)
        return np.where(ndp, 0, depth_image(example)[0])

    return drawing.collect(examples, sight.see, odd=sight.odd, wanted=wanted, track=track)


def linear_decay(step: int, settings: Settings) -> float:
    """Learning rate: even for the first half, then straight to 0 (as Zhu et al., ICCV 2017)."""
    return settings.rate * min(1.0, 2 * (1 - step / settings.steps))
