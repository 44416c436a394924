"""Training loss: likelihood of the truth in holes, and of the camera's own depth elsewhere."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from starling.learning.completion.small.crops import SmallBatch
from starling.learning.completion.small.network import SmallNetwork, SmallOutput
from starling.learning.completion.small.settings import SmallSettings
from starling.learning.networks.training.learner import (
    STEEPEST,
    Draw,
    Learner,
    decaying_adam,
    descend,
    mean,
    mixed_precision,
    one_cycle,
)

_FALSE = 0.1  # The camera's depth counts as false above this error of its natural logarithm.
# Weights of the losses, relative to the likelihood in holes.
_OWN, _BELOW, _JUDGED, _METRES = 0.2, 0.2, 1.0, 0.5


class SmallLearner(Learner[SmallBatch]):
    """Trains `networks["small"]`."""

    def __init__(self, network: SmallNetwork, settings: SmallSettings) -> None:
        self.settings = settings
        super().__init__({"small": network}, [decaying_adam(network, settings.weight_decay)])

    def update(self, draw: Draw[SmallBatch], step: int) -> dict[str, float]:
        """Take a step and return the losses before it, by name."""
        self.set_rate(one_cycle(step, self.settings))
        batch = draw("crops")
        with mixed_precision(batch.channels.device):
            output = self.networks["small"](batch.channels, batch.proposed)
        losses = losses_of(output, batch)
        total = sum(losses.values(), torch.zeros(()))
        descend(self.optimizers[0], total, steepest=STEEPEST)
        return {"loss": total.item(), **{name: value.item() for name, value in losses.items()}}


def losses_of(output: SmallOutput, batch: SmallBatch) -> dict[str, Tensor]:
    """Return the losses by name.

    - holes: negative log-likelihood (Laplace) of the truth's logarithm.
    - metres: mean error in holes in units of the frame's median depth, the unit of the evaluation.
    - own: likelihood of the camera's own depth, which trains the scale only.
    - below: error of the network's depth at pixels with sensor depth.
    - judged: cross-entropy of the detection of false sensor depth.
    """
    hole, valid = batch.known * (1 - batch.valid), batch.known * batch.valid
    error = (output.log_depth - batch.truth).abs()
    sensor_error = (batch.sensor - batch.truth).abs()
    sharp = torch.exp(-output.log_scale)
    detection = functional.binary_cross_entropy_with_logits(
        output.false, (sensor_error > _FALSE).float(), reduction="none"
    )
    return {
        "holes": mean(error * sharp + output.log_scale, hole),
        "metres": _METRES * mean(torch.exp(batch.truth) * error, hole),
        "own": _OWN * mean(sensor_error * sharp + output.log_scale, valid),
        "below": _BELOW * mean(error, valid),
        "judged": _JUDGED * mean(detection, valid),
    }
