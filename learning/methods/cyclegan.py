"""CycleGAN, the seed's second baseline: translation learnt from two heaps that nobody paired.

Source: Zhu et al., Unpaired image-to-image translation using cycle-consistent adversarial
networks, ICCV 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from torch import Tensor, nn

from starling.learning.data.example import Example
from starling.learning.networks.training.learner import Draw, Learner, descend, initialised, sparing
from starling.learning.networks.training.samples import Batch
from starling.learning.networks.training.settings import Settings
from starling.learning.networks.training.translation import (
    ADVERSARIAL,
    DEPTH,
    PatchDiscriminator,
    TranslationPredictor,
    Translator,
    adversary,
    fit_translation,
    judged,
    linear_decay,
    load_translation,
)
from starling.sim.console import progress

CYCLE_WEIGHT = 10.0  # Against the discriminators' verdicts (Zhu et al., sec. 4).
IDENTITY_WEIGHT = 5.0  # Half of it (sec. 5.2).
_GENERATORS = ("spoil", "mend")  # Reference depth to the device's and back.
_DISCRIMINATORS = ("of_device", "of_reference")  # Real device depth? Real reference depth?


class CycleGanLearner(Learner[Batch]):
    """Two generators, each the other's way back, and a discriminator of either heap."""

    def __init__(
        self, generators: Sequence[nn.Module], discriminators: Sequence[nn.Module], how: Settings
    ) -> None:
        names, networks = (*_GENERATORS, *_DISCRIMINATORS), (*generators, *discriminators)
        optimizers = [adversary(*generators), adversary(*discriminators)]
        super().__init__(dict(zip(names, networks, strict=True)), optimizers)
        self.settings = how

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        self.set_rate(linear_decay(step, self.settings))
        # Drawn apart, so that the two never show the same place on purpose.
        reference, device = draw("reference").seen, draw("device").target
        spoil, mend, of_device, of_reference = self.networks.values()
        with sparing(reference.device):
            spoilt, mended = spoil(reference), mend(device)
            fooled = judged(of_device(spoilt), True) + judged(of_reference(mended), True)
            cycle = _apart(mend(spoilt), reference) + _apart(spoil(mended), device)
            identity = _apart(spoil(device), device) + _apart(mend(reference), reference)
        descend(self.optimizers[0], fooled + CYCLE_WEIGHT * cycle + IDENTITY_WEIGHT * identity)
        with sparing(reference.device):
            real = judged(of_device(device), True) + judged(of_reference(reference), True)
            false = judged(of_device(spoilt.detach()), False)
            false = false + judged(of_reference(mended.detach()), False)
        told = (real + false) / 2
        descend(self.optimizers[1], told)
        losses = {"fooled": fooled, "cycle": cycle, "identity": identity, "told": told}
        return {name: loss.item() for name, loss in losses.items()}


def _apart(made: Tensor, wanted: Tensor) -> Tensor:
    return (made - wanted).abs().float().mean()


@dataclass(frozen=True, kw_only=True, slots=True)
class CycleGan:
    """How it learns."""

    name: ClassVar[str] = "cyclegan"
    settings: Settings = ADVERSARIAL

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
        build = partial(PatchDiscriminator, 1)
        generators = [initialised(Translator, seed + number) for number in range(2)]
        discriminators = [initialised(build, seed + number) for number in range(2)]
        return fit_translation(
            examples,
            CycleGanLearner(generators, discriminators, self.settings),
            "spoil",
            self.settings,
            sight=DEPTH,
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
        return load_translation(folder, self.name, Translator(), DEPTH)
