"""Training: the network learns to predict the noise in the truth's latents (Ho et al., 2020).

The draw of a step depends on the seed and the step's number only. Training that was interrupted
continues from its last checkpoint with bit-identical results on one machine and thread count.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn, optim

from starling.learning.completion.diffusion import Variant, span, weights
from starling.learning.completion.diffusion.conditioning import trainable_parameters
from starling.learning.completion.diffusion.data import (
    DiffusionBatch,
    TrainingSamples,
    draw_batches,
)
from starling.learning.completion.diffusion.model import DiffusionModel, untrained_model
from starling.learning.completion.diffusion.weights import Weights
from starling.learning.networks import checkpoint
from starling.learning.networks.device import mixed_precision
from starling.learning.networks.training import settings_identity
from starling.patterns import errors
from starling.patterns.errors import refuse
from starling.sim.console import output, progress
from starling.sim.randomness import generator

CHECKPOINT = "training.pt"
CURVE = "loss.csv"
WEIGHTS = "weights"
_ENTRIES = {"identity": str, "networks": dict, "optimizer": dict, "step": int, "curve": list}
_KIND = "diffusion for completion"


@dataclass(frozen=True, kw_only=True, slots=True)
class DiffusionSettings:
    """Training settings. The defaults are the paper's (appendix B): three days on an A100."""

    steps: int = 36_000
    batch: int = 32  # Samples a step.
    rate: float = 3e-5  # Learning rate of Adam.
    crop_px: tuple[int, int] = (512, 512)  # (h, w); eight times the mask of sec. 5.1.
    at_once: int = 4  # Samples on the device at a time; the gradients of a step are summed.
    save_every: int = 500  # Steps between checkpoints.

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "at_once", "save_every"):
            errors.in_interval(name, getattr(self, name), 1, 10_000_000)
        for side in self.crop_px:
            errors.in_interval("crop_px", side, 1, 16384, "Give height and width [px].")
        errors.positive("rate", self.rate)


@dataclass(slots=True)
class _Run:
    """State of a training run."""

    model: DiffusionModel
    optimizer: optim.Optimizer
    step: int = 0
    curve: list[float] = field(default_factory=list)


def train(
    parts: Weights,
    variant: Variant,
    samples: TrainingSamples,
    settings: DiffusionSettings,
    *,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> DiffusionModel:
    """Train to the end, or continue from the checkpoint in `folder`.

    Args:
        parts: weights of a text-to-image model; its network is changed in place.
        variant: name of the conditioning.
        samples: training set with at least one sample.
        settings: steps, batches and learning rate.
        folder: gets `training.pt`, `loss.csv` and, at the end, `weights/`, for `trained_model`.
        seed: seed of all random draws.
        track: wraps the loop over steps.

    Returns:
        The trained model.

    Raises:
        InputError: see `untrained_model` and `draw_batches`; or if there is no sample, a loss is
            not finite; the checkpoint is damaged or of another training, or the folder has weights
            but no checkpoint.
    """
    if not len(samples):
        raise refuse("samples", "must be at least one", 0, "Give frames with ground truth.")
    text = settings_identity(settings)
    identity = f"{variant} {text} seed {seed} data {samples.identity} of {_checksum(parts)}"
    path = folder / CHECKPOINT
    if (folder / WEIGHTS).exists() and not path.exists():
        rule = f"must not hold {WEIGHTS}/ of another training"
        raise refuse("folder", rule, folder, "Choose an empty folder.")
    model = untrained_model(parts, variant, seed=seed)
    run = _Run(model, optim.Adam(trainable_parameters(model.conditioning), lr=settings.rate))
    if path.exists():
        with errors.naming(path):
            _resume(run, checkpoint.load(path, _KIND, _ENTRIES), identity)
    for step in track(range(run.step, settings.steps), f"train diffusion-{variant}"):
        run.curve.append(_step(run, samples, settings, seed, step))
        run.step = step + 1
        if run.step % settings.save_every == 0 or run.step == settings.steps:
            _save(run, folder, identity)
    model.conditioning.networks.requires_grad_(False)
    if not (folder / WEIGHTS).exists():
        networks: Any = model.conditioning.networks
        by_name = {name: networks[name] for name in networks}
        whole = dataclasses.replace(parts, scheduler=model.scheduler, **by_name)
        with output.OutputFolder(folder / WEIGHTS) as out:
            weights.save(whole, out.partial)
    return model


def loss(model: DiffusionModel, batch: DiffusionBatch, *, seed: int) -> Tensor:
    """Mean squared error (b,) of the predicted noise.

    Steps are uniform over the noise schedule. Latent cells with unknown truth do not count. With a
    hole mask, only cells with a hole count (the paper's sec. 5.1).

    Args:
        model: the model to train.
        batch: samples.
        seed: fixes, with the number of each sample, its step and noise.
    """
    device, side = batch.truth.device, span.factor(model.vae)
    counted = 1 - span.cells(batch.unknown, side)
    if model.conditioning.variant == "rgbd-mask":
        counted = counted * span.cells(batch.inputs.hole, side)
    with mixed_precision(device):
        with torch.no_grad():
            clean = span.encode_depth(model.vae, batch.truth).float()
            condition = model.conditioning.condition(batch.inputs, model.vae)
        step, noise = _noise(batch.numbers, model, clean, seed)
        scheduler: Any = model.scheduler
        noisy = scheduler.add_noise(clean, noise, step)
        text = model.text.expand(len(batch.numbers), -1, -1)
        predicted = model.conditioning.noise(noisy, step, condition, text)
    error = ((predicted.float() - noise) ** 2).mean(dim=1, keepdim=True) * counted
    return error.sum(dim=(1, 2, 3)) / counted.sum(dim=(1, 2, 3)).clamp(min=1)


def _step(
    run: _Run, samples: TrainingSamples, settings: DiffusionSettings, seed: int, step: int
) -> float:
    run.optimizer.zero_grad()
    total = 0.0
    for batch in draw_batches(
        samples,
        step=step,
        count=settings.batch,
        at_once=settings.at_once,
        crop_px=settings.crop_px,
        seed=seed,
        multiple=run.model.multiple,
        device=run.model.text.device,
    ):
        mean = loss(run.model, batch, seed=seed).sum() / settings.batch
        mean.backward()
        total += mean.item()
    if not math.isfinite(total):
        remedy = f"Stopped at batch {step}: look at its inputs, or lower the rate."
        raise refuse("loss", "must be a finite number", total, remedy)
    run.optimizer.step()
    return total


def _noise(
    numbers: Sequence[int], model: DiffusionModel, like: Tensor, seed: int
) -> tuple[Tensor, Tensor]:
    """Draw the steps (b,) and the noise (b, 4, h, w), each from the number of its sample."""
    times, noises = [], []
    for number in numbers:
        rng = generator(seed, number, "completion", "noise")
        times.append(int(rng.integers(model.scheduler.config["num_train_timesteps"])))
        noises.append(rng.standard_normal(like.shape[1:]).astype(np.float32))
    return torch.tensor(times).to(like.device), torch.from_numpy(np.stack(noises)).to(like.device)


def _save(run: _Run, folder: Path, identity: str) -> None:
    # Write the curve first: after a kill in between, resumed training overwrites its last lines.
    lines = ["step,loss", *(f"{step},{value:.9g}" for step, value in enumerate(run.curve))]
    output.write_file(folder / CURVE, ("\n".join(lines) + "\n").encode(), force=True)
    content = {
        "identity": identity,
        "networks": run.model.conditioning.networks.state_dict(),
        "optimizer": run.optimizer.state_dict(),
        "step": run.step,
        "curve": run.curve,
    }
    checkpoint.save(folder / CHECKPOINT, _KIND, content)


def _resume(run: _Run, content: dict[str, Any], identity: str) -> None:
    if content["identity"] != identity:
        rule = "must belong to this training, with the same samples, weights, settings and seed"
        raise refuse("checkpoint", rule, content["identity"], "Choose an empty folder.")
    checkpoint.restore(run.model.conditioning.networks, content["networks"])
    checkpoint.restore_optimizer(run.optimizer, content["optimizer"])
    run.step, run.curve = content["step"], content["curve"]


def _checksum(parts: Weights) -> str:
    """Return a checksum of the last layer, which identifies the weights."""
    layer: nn.Module = parts.unet.conv_out
    values = next(layer.parameters()).detach().cpu().numpy()
    return f"{zlib.crc32(np.ascontiguousarray(values).data):08x}"
