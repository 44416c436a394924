"""How the network learns: likelihood of the truth in holes, and of the camera's own depth."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from starling.learning.completion.small.crops import Batch
from starling.learning.completion.small.network import SmallNetwork, Told
from starling.learning.completion.small.settings import Settings
from starling.learning.networks.training.learner import (
    STEEPEST,
    Draw,
    Learner,
    decaying,
    descend,
    mean,
    one_cycle,
    sparing,
)

_FALSE = 0.1  # The camera's depth is wrong where it is off by more, in the logarithm.
_OWN, _BELOW, _JUDGED, _METRES = 0.2, 0.2, 1.0, 0.5  # Weights beside 1 of the holes' likelihood.


class SmallLearner(Learner[Batch]):
    """Learns `networks["small"]`."""

    def __init__(self, network: SmallNetwork, settings: Settings) -> None:
        self.settings = settings
        super().__init__({"small": network}, [decaying(network, settings.weight_decay)])

    def update(self, draw: Draw[Batch], step: int) -> dict[str, float]:
        """Take a step and name the losses before it."""
        self.set_rate(one_cycle(step, self.settings))
        batch = draw("crops")
        with sparing(batch.channels.device):
            told = self.networks["small"](batch.channels, batch.proposed)
        losses = losses_of(told, batch)
        total = sum(losses.values(), torch.zeros(()))
        descend(self.optimizers[0], total, steepest=STEEPEST)
        return {"loss": total.item(), **{name: one.item() for name, one in losses.items()}}


def losses_of(told: Told, batch: Batch) -> dict[str, Tensor]:
    """What the network pays, by what for.

    holes: Laplace's negative log likelihood of the truth's logarithm. metres: mean error of holes
    in units of the frame's median depth, as errors are judged in metres and far ones count more.
    own: likelihood of the camera's own depth where it has some, which teaches the scale alone.
    below: error of what would be said there in its stead. judged: whether the camera is wrong.
    """
    hole, valid = batch.known * (1 - batch.valid), batch.known * batch.valid
    error = (told.log_depth - batch.truth).abs()
    own = (batch.given - batch.truth).abs()
    sharp = torch.exp(-told.log_scale)
    judged = functional.binary_cross_entropy_with_logits(
        told.false, (own > _FALSE).float(), reduction="none"
    )
    return {
        "holes": mean(error * sharp + told.log_scale, hole),
        "metres": _METRES * mean(torch.exp(batch.truth) * error, hole),
        "own": _OWN * mean(own * sharp + told.log_scale, valid),
        "below": _BELOW * mean(error, valid),
        "judged": _JUDGED * mean(judged, valid),
    }
