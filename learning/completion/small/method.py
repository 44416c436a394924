"""The compact network as a method of completion: trained, kept in a folder, read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from starling.learning.completion.frame import Frame
from starling.learning.completion.method import Completed
from starling.learning.completion.small.crops import Crops, Sample
from starling.learning.completion.small.learner import SmallLearner
from starling.learning.completion.small.network import SmallNetwork, kept
from starling.learning.completion.small.seen import seen
from starling.learning.completion.small.settings import Settings
from starling.learning.networks import checkpoint
from starling.learning.networks.training.learner import initialised, placed, sparing
from starling.learning.networks.training.loop import train
from starling.sim.console import progress

WEIGHTS = "weights.pt"
_KIND = "small completion"
_LAPLACE = np.float32(np.sqrt(2))  # Standard deviation over b.


@dataclass(frozen=True, slots=True, eq=False)
class Small:
    """The network, ready for use."""

    network: SmallNetwork

    @property
    def name(self) -> str:
        """`small`."""
        return "small"

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame; the camera's own depth stays, but where it is likely false.

        `sigma_m` is the standard deviation of the Laplace distribution that the logarithm of
        depth has, times depth.
        """
        view = seen(frame)
        where = next(self.network.parameters()).device
        with torch.inference_mode(), sparing(where):
            told = self.network(_tensor(view.channels, where), _tensor(view.proposed, where))
            given, valid = (_tensor(one[None], where) for one in (view.given, view.valid))
            log_depth = kept(told, given, valid)[0, 0].cpu().numpy()
            scale = told.log_scale[0, 0].exp().cpu().numpy()
        depth_m = np.exp(log_depth) * np.float32(view.median_m)
        own = frame.valid & (log_depth == view.given)
        depth_m = np.where(own, frame.depth_m, depth_m).astype(np.float32)  # Bit for bit.
        return Completed(depth_m=depth_m, sigma_m=_LAPLACE * scale * depth_m)


def fit(
    samples: Sequence[Sample],
    settings: Settings,
    *,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> Small:
    """Learn, or go on with what lies in the folder, and leave the weights there.

    Args:
        samples: frames whose truth is known.
        settings: steps, batches and rates.
        folder: gets checkpoint, loss curve and weights.
        seed: fixes first weights and crops.
        track: wraps the loop over steps.

    Raises:
        InputError: if there is no sample, or as `starling.learning.networks.training.loop.train`.
    """
    lot = Crops(samples=samples, settings=settings, seed=seed)
    network = initialised(SmallNetwork, seed)
    learner = SmallLearner(network, settings)
    learnt = train(learner, lot, settings, kind=f"{_KIND} training", folder=folder, track=track)
    network.load_state_dict(learnt["small"].state_dict())
    save(Small(network), folder)
    return load(folder)


def save(small: Small, folder: Path) -> None:
    """Leave the weights in a folder.

    Raises:
        InputError: if they cannot be written.
    """
    weights = small.network.state_dict()
    checkpoint.save(folder / WEIGHTS, _KIND, {"weights": weights})


def load(folder: Path | str) -> Small:
    """Read what `fit` has left in a folder.

    Raises:
        InputError: if there are no weights, they are of another method, or damaged.
    """
    network = SmallNetwork()
    content = checkpoint.load(Path(folder) / WEIGHTS, _KIND)
    checkpoint.restore(network, content["weights"])
    return Small(placed(network).eval().requires_grad_(False))


def _tensor(images: np.ndarray, where: torch.device) -> torch.Tensor:
    batch = torch.from_numpy(images.astype(np.float32))[None]
    return batch.to(device=where, memory_format=torch.channels_last)
