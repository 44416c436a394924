"""The compact network as a completion method: loss, training, saving and loading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from starling.learning.completion.method import Completed, CompletionFrame
from starling.learning.completion.small import expected_error
from starling.learning.completion.small.crops import (
    FrameCrops,
    FrameSample,
    SmallBatch,
    SmallSettings,
)
from starling.learning.completion.small.expected_error import (
    ExpectedError,
    calibrated,
    group_masks,
)
from starling.learning.completion.small.network import (
    SmallNetwork,
    SmallOutput,
    final_log_depth,
    small_input,
)
from starling.learning.networks import checkpoint
from starling.learning.networks.device import initialised, mixed_precision, to_device
from starling.learning.networks.training import (
    STEEPEST,
    Draw,
    Learner,
    decaying_adam,
    descend,
    mean,
    one_cycle,
    train,
)
from starling.patterns import errors
from starling.sim.console import progress

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


WEIGHTS = "weights.pt"
_KIND = "small completion"
_LAPLACE = np.float32(np.sqrt(2))  # Standard deviation of a Laplace distribution over its scale b.


@dataclass(frozen=True, slots=True, eq=False)
class Small:
    """The trained network."""

    name: ClassVar[str] = "small"
    network: SmallNetwork
    error: ExpectedError = field(default_factory=ExpectedError)

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame. The camera's own depth is kept except where it is probably false.

        The network's own sigma is depth times the standard deviation of the Laplace distribution
        of its logarithm; see `expected_error` for `sigma_m`.
        """
        inputs = small_input(frame)
        device = next(self.network.parameters()).device
        with torch.inference_mode(), mixed_precision(device):
            output = self.network(
                _tensor(inputs.channels, device), _tensor(inputs.proposed, device)
            )
            sensor, valid = (
                _tensor(image[None], device) for image in (inputs.sensor, inputs.valid)
            )
            log_depth = final_log_depth(output, sensor, valid)[0, 0].cpu().numpy()
            scale = output.log_scale[0, 0].exp().cpu().numpy()
        depth_m = np.exp(log_depth) * np.float32(inputs.median_m)
        is_sensor = frame.valid & (log_depth == inputs.sensor)
        depth_m = np.where(is_sensor, frame.depth_m, depth_m).astype(np.float32)  # Bit-identical.
        own_sigma_m = _LAPLACE * scale * depth_m
        masks = group_masks(frame.valid, is_sensor)
        sigma_m, half_m = calibrated(self.error, depth_m, own_sigma_m, masks)
        return Completed(depth_m=depth_m, sigma_m=sigma_m, half_m=half_m)


def fit(
    samples: Sequence[FrameSample],
    settings: SmallSettings,
    *,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> Small:
    """Train the network, or continue from the folder's checkpoint, and save the weights.

    Args:
        samples: frames with ground truth.
        settings: steps, batches and learning rates.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of initial weights and crops.
        track: wraps the loop over steps.

    Raises:
        InputError: if there is no sample; see also
            `starling.learning.networks.training.train`.
    """
    batches = FrameCrops(samples=samples, settings=settings, seed=seed)
    network = initialised(SmallNetwork, seed)
    learner = SmallLearner(network, settings)
    trained = train(
        learner, batches, settings, kind=f"{_KIND} training", folder=folder, track=track
    )
    network.load_state_dict(trained["small"].state_dict())
    save(Small(network), folder)
    return load(folder)


def save(small: Small, folder: Path) -> None:
    """Save the weights to a folder. A calibration of earlier weights there is deleted.

    Raises:
        InputError: if they cannot be written.
    """
    (folder / expected_error.FILE).unlink(missing_ok=True)
    weights = small.network.state_dict()
    checkpoint.save(folder / WEIGHTS, _KIND, {"weights": weights})


def load(folder: Path | str) -> Small:
    """Load the weights that `fit` saved to a folder, and the expected error if it is there.

    Raises:
        InputError: if there are no weights, they are of another method, or a file is damaged.
    """
    network = SmallNetwork()
    path = Path(folder) / WEIGHTS
    content = checkpoint.load(path, _KIND, {"weights": dict})
    with errors.naming(path):
        checkpoint.restore(network, content["weights"])
    return Small(to_device(network).eval().requires_grad_(False), expected_error.load(Path(folder)))


def _tensor(images: np.ndarray, device: torch.device) -> torch.Tensor:
    batch = torch.from_numpy(images.astype(np.float32))[None]
    return batch.to(device=device, memory_format=torch.channels_last)
