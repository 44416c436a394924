"""Image translation of depth images: maps reference depth to depth with the device's holes."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from torch import Tensor, nn, optim
from torch.nn import functional

from starling.learning.data.example import Example, Image, Mask
from starling.learning.networks import checkpoint, samples
from starling.learning.networks.channels import check_size
from starling.learning.networks.device import run_network
from starling.learning.networks.samples import Batch, check_same_size
from starling.learning.networks.training import Learner, TrainingSettings, train
from starling.learning.networks.unet import UNet
from starling.patterns.errors import refuse
from starling.sim.console import progress

UNIT_M = 4.0  # Depth of image value 1 [m].
FARTHEST_M = 16.0  # Greater depths are clipped [m].
# Learning rate of Isola et al. and Zhu et al.; training diverges at ten times this rate.
ADVERSARIAL = TrainingSettings(steps=3000, batch=4, rate=2e-4)
_BETAS = (0.5, 0.999)  # Adam's decay rates of Isola et al. and Zhu et al.


def adversary(*networks: nn.Module) -> optim.Optimizer:
    """Build the optimiser of generators or of discriminators."""
    return optim.Adam(
        itertools.chain(*(network.parameters() for network in networks)), betas=_BETAS
    )


class Translator(nn.Module):
    """Maps a depth image (b, 1, h, w) to a depth image; the identity before training."""

    def __init__(self) -> None:
        super().__init__()
        self.unet = UNet(1)

    def forward(self, depth: Tensor) -> Tensor:
        return depth + self.unet(depth)


class PatchDiscriminator(nn.Module):
    """Logits that patches of 46x46 pixels are real, about (b, 1, h / 8, w / 8).

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


def least_squares_loss(logit: Tensor, real: bool) -> Tensor:
    """Squared distance () of logits from the label (Mao et al., Least squares GANs, ICCV 2017)."""
    return ((logit.float() - float(real)) ** 2).mean()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TranslatorInput:
    """Input channels of a translator, with the depth image first."""

    names: tuple[str, ...]
    odd: tuple[int, ...]  # Channels that change sign when flipped vertically.
    see: Callable[[Example], Image]  # Returns (c, h, w).


@dataclass(frozen=True, slots=True, eq=False)
class TranslationPredictor:
    """A trained translator. It is deterministic, so that its probabilities are not frequencies."""

    network: nn.Module
    shape: tuple[int, int]  # (h, w) of the training images.
    inputs: TranslatorInput

    @property
    def only_shape(self) -> tuple[int, int]:
        """The only image size (h, w) that it predicts."""
        return self.shape

    def depth_m(self, example: Example) -> Image:
        """Predict the device's depth (h, w) [m]; values may be negative.

        Raises:
            InputError: if the example has another size than the training images.
        """
        check_same_size(example, self.shape)
        return run_network(self.network, self.inputs.see(example)) * np.float32(UNIT_M)

    def probability(self, example: Example) -> Image:
        """Return how far each depth moved from the reference towards zero, (h, w), 0 to 1.

        From 0.5 on, the depth is nearer to zero than to the reference, which the seed paper counts
        as no depth. It is 1 where the reference is unknown.

        Raises:
            InputError: if the example has another size than the training images.
        """
        predicted = self.depth_m(example)
        reference = depth_image(example)[0] * np.float32(UNIT_M)
        known = reference > 0
        ratio = np.where(known, predicted, 0) / np.where(known, reference, 1)
        return (1 - np.clip(ratio, 0, 1)).astype(np.float32)


def depth_image(example: Example) -> Image:
    """Return reference depth (1, h, w), 1 at `UNIT_M`; 0 where unknown, as devices write it.

    Raises:
        InputError: if it has another size than the geometry states, or nothing is known.
    """
    check_size(example.info, "depth_m", example.depth_m)
    known = np.isfinite(example.depth_m)
    if not known.any():
        name = f"reference depth of scene {example.scene}"
        raise refuse(name, "must be known somewhere", "no pixel", "Check its truth.png.")
    depth = np.where(known, np.minimum(example.depth_m, FARTHEST_M), 0)
    return (depth / UNIT_M).astype(np.float32)[None]


DEPTH = TranslatorInput(names=("depth",), odd=(), see=depth_image)


def linear_decay(step: int, settings: TrainingSettings) -> float:
    """Return the learning rate: constant for half of the steps, then linear to 0 (Zhu et al.)."""
    return settings.rate * min(1.0, 2 * (1 - step / settings.steps))


class Translation(ABC):
    """A method whose generator maps reference depth to the device's depth with its holes."""

    name: ClassVar[str]
    settings: TrainingSettings
    predicts: ClassVar[str]  # Name of the network that predicts, a generator.
    generator: ClassVar[type[nn.Module]]
    inputs: ClassVar[TranslatorInput]

    @abstractmethod
    def learner(self, seed: int) -> Learner[Batch]:
        """Build the initial generators and discriminators."""

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> TranslationPredictor:
        """Train, or continue from the folder's checkpoint, and save the weights there.

        Raises:
            InputError: see `starling.learning.networks.samples.collect` and
                `starling.learning.networks.training.train`.
        """
        learner = self.learner(seed)
        scenes = samples.collect(
            examples,
            self.inputs.see,
            odd=self.inputs.odd,
            target=_device_image,
            folder=folder,
            track=track,
        )
        crops = samples.Crops(samples=scenes, settings=self.settings, seed=seed)
        kind = f"{self.name} training"
        trained = train(learner, crops, self.settings, kind=kind, folder=folder, track=track)
        network, shape = trained[self.predicts], examples[0].info.shape
        checkpoint.save_network(folder, self.name, network, self.inputs.names, shape)
        return TranslationPredictor(network, shape, self.inputs)

    def load(self, folder: Path) -> TranslationPredictor:
        """Load the weights that `fit` saved.

        Raises:
            InputError: see `starling.learning.networks.checkpoint.load_network`.
        """
        network = self.generator()
        shape = checkpoint.load_network(folder, self.name, network, self.inputs.names)
        return TranslationPredictor(network, shape, self.inputs)


def _device_image(example: Example) -> Image:
    """Return the target: reference depth (h, w) with the device's holes at 0."""
    ndp: Mask = np.asarray(example.ndp)
    return np.where(ndp, 0, depth_image(example)[0])
