"""CycleGAN, the seed paper's second baseline: translation learnt from unpaired sets of images.

Source: Zhu et al., Unpaired image-to-image translation using cycle-consistent adversarial
networks, ICCV 2017.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from torch import Tensor, nn

from starling.learning.methods.translation import (
    ADVERSARIAL,
    DEPTH,
    PatchDiscriminator,
    Translation,
    Translator,
    adversary,
    least_squares_loss,
    linear_decay,
)
from starling.learning.networks.device import initialised, mixed_precision
from starling.learning.networks.samples import Batch
from starling.learning.networks.training import Draw, Learner, TrainingSettings, descend

CYCLE_WEIGHT = 10.0  # Relative to the discriminators' loss (Zhu et al., sec. 4).
IDENTITY_WEIGHT = 5.0  # Half of the cycle weight (sec. 5.2).
_GENERATORS = ("spoil", "mend")  # Reference depth to the device's depth, and back.
# Is the device depth real? Is the reference depth real?
_DISCRIMINATORS = ("of_device", "of_reference")


class CycleGanLearner(Learner[Batch]):
    """Two inverse generators and a discriminator for each set of images."""

    def __init__(
        self,
        generators: Sequence[nn.Module],
        discriminators: Sequence[nn.Module],
        settings: TrainingSettings,
    ) -> None:
        names, networks = (*_GENERATORS, *_DISCRIMINATORS), (*generators, *discriminators)
        optimizers = [adversary(*generators), adversary(*discriminators)]
        super().__init__(dict(zip(names, networks, strict=True)), optimizers)
        self.settings = settings

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        self.set_rate(linear_decay(step, self.settings))
        # Independent draws: the crops are not paired.
        reference, device = draw("reference").inputs, draw("device").target
        to_device, to_reference, device_critic, reference_critic = self.networks.values()
        with mixed_precision(reference.device):
            fake_device, fake_reference = to_device(reference), to_reference(device)
            fooled = least_squares_loss(device_critic(fake_device), True) + least_squares_loss(
                reference_critic(fake_reference), True
            )
            cycle = _mean_difference(to_reference(fake_device), reference) + _mean_difference(
                to_device(fake_reference), device
            )
            identity = _mean_difference(to_device(device), device) + _mean_difference(
                to_reference(reference), reference
            )
        descend(self.optimizers[0], fooled + CYCLE_WEIGHT * cycle + IDENTITY_WEIGHT * identity)
        with mixed_precision(reference.device):
            real = least_squares_loss(device_critic(device), True) + least_squares_loss(
                reference_critic(reference), True
            )
            false = least_squares_loss(device_critic(fake_device.detach()), False)
            false = false + least_squares_loss(reference_critic(fake_reference.detach()), False)
        discrimination = (real + false) / 2
        descend(self.optimizers[1], discrimination)
        losses = {"fooled": fooled, "cycle": cycle, "identity": identity, "told": discrimination}
        return {name: loss.item() for name, loss in losses.items()}


def _mean_difference(image: Tensor, target: Tensor) -> Tensor:
    return (image - target).abs().float().mean()


@dataclass(frozen=True, kw_only=True)
class CycleGan(Translation):
    """CycleGAN with its settings."""

    name = "cyclegan"
    predicts = "spoil"
    generator = Translator
    inputs = DEPTH
    settings: TrainingSettings = ADVERSARIAL

    def learner(self, seed: int) -> CycleGanLearner:
        """Build the initial generators and discriminators."""
        build = partial(PatchDiscriminator, 1)
        generators = [initialised(Translator, seed + number) for number in range(2)]
        discriminators = [initialised(build, seed + number) for number in range(2)]
        return CycleGanLearner(generators, discriminators, self.settings)
