"""Training: the network learns to tell the noise in the truth's latents (Ho et al., 2020).

What a step draws depends on the seed and its number alone, so training that was killed goes on from
its last checkpoint to the very same bits, on one machine with one number of threads.
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

from starling.learning.completion.diffusion import latents, weights
from starling.learning.completion.diffusion.batch import Batch, draw
from starling.learning.completion.diffusion.conditioning import trainable
from starling.learning.completion.diffusion.model import Model, untrained
from starling.learning.completion.diffusion.samples import Samples
from starling.learning.completion.diffusion.variants import Variant
from starling.learning.completion.diffusion.weights import Weights
from starling.learning.networks import checkpoint
from starling.learning.networks.training.learner import sparing
from starling.patterns import errors
from starling.patterns.errors import refuse
from starling.sim.console import output, progress
from starling.sim.randomness import generator

CHECKPOINT = "training.pt"
CURVE = "loss.csv"
WEIGHTS = "weights"
_KIND = "diffusion for completion"


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """The paper's, appendix B: three days of one A100."""

    steps: int = 36_000
    batch: int = 32  # Samples a step.
    rate: float = 3e-5  # Adam's.
    crop_px: tuple[int, int] = (512, 512)  # Eight times sec. 5.1's mask: (h, w).
    at_once: int = 4  # Samples that the device holds at a time; gradients of a step add up.
    save_every: int = 500  # Steps between checkpoints.

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "at_once", "save_every"):
            errors.in_interval(name, getattr(self, name), 1, 10_000_000)
        for side in self.crop_px:
            errors.in_interval("crop_px", side, 1, 16384, "Give height and width [px].")
        errors.positive("rate", self.rate)


@dataclass(slots=True)
class _Run:
    """Where a training stands."""

    model: Model
    optimizer: optim.Optimizer
    step: int = 0
    curve: list[float] = field(default_factory=list)


def train(
    parts: Weights,
    variant: Variant,
    drawn_from: Samples,
    settings: Settings,
    *,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> Model:
    """Train to the end, or go on where `folder`'s checkpoint stands.

    Args:
        parts: of a text-to-image model; its network is changed.
        variant: how the network is told what is seen.
        drawn_from: at least one; asked for each when it is drawn.
        settings: steps, batches and rate.
        folder: gets `training.pt`, `loss.csv` and at the end `weights/`, which `trained` reads.
        seed: fixes what is drawn.
        track: wraps the loop over steps.

    Returns:
        The model, ready for use.

    Raises:
        InputError: as `untrained` and `draw`; if there is no sample, a loss is no number,
            the checkpoint is damaged or of another training, or weights stand there without one.
    """
    if not len(drawn_from):
        raise refuse("samples", "must be at least one", 0, "Give frames with truth.")
    identity = f"{variant} {settings} seed {seed} data {drawn_from.identity} of {_of(parts)}"
    path = folder / CHECKPOINT
    if (folder / WEIGHTS).exists() and not path.exists():
        rule = f"must not hold {WEIGHTS}/ of another training"
        raise refuse("folder", rule, folder, "Choose an empty folder.")
    model = untrained(parts, variant, seed=seed)
    run = _Run(model, optim.Adam(trainable(model.conditioning), lr=settings.rate))
    if path.exists():
        _resume(run, checkpoint.load(path, _KIND), identity)
    for step in track(range(run.step, settings.steps), f"train diffusion-{variant}"):
        run.curve.append(_step(run, drawn_from, settings, seed, step))
        run.step = step + 1
        if run.step % settings.save_every == 0 or run.step == settings.steps:
            _save(run, folder, identity)
    model.conditioning.networks.requires_grad_(False)
    if not (folder / WEIGHTS).exists():
        networks: Any = model.conditioning.networks
        named = {name: networks[name] for name in networks}
        whole = dataclasses.replace(parts, scheduler=model.scheduler, **named)
        with output.OutputFolder(folder / WEIGHTS) as out:
            weights.save(whole, out.partial)
    return model


def loss(model: Model, batch: Batch, *, seed: int) -> Tensor:
    """Mean squared error of the noise told, (b,).

    Times are uniform over the noise schedule. Cells in which the truth is not wholly known do not
    count; with a mask of holes only cells with a hole do (the paper's sec. 5.1).

    Args:
        model: to be trained.
        batch: of samples.
        seed: fixes, with each sample's number, its time and noise.
    """
    where, side = batch.truth.device, latents.factor(model.vae)
    counted = 1 - latents.cells(batch.unknown, side)
    if model.conditioning.variant == "rgbd-mask":
        counted = counted * latents.cells(batch.seen.hole, side)
    with sparing(where):
        with torch.no_grad():
            clean = latents.encode_depth(model.vae, batch.truth).float()
            condition = model.conditioning.condition(batch.seen, model.vae)
        step, noise = _noise(batch.numbers, model, clean, seed)
        scheduler: Any = model.scheduler
        noisy = scheduler.add_noise(clean, noise, step)
        text = model.text.expand(len(batch.numbers), -1, -1)
        told = model.conditioning.noise(noisy, step, condition, text)
    wrong = ((told.float() - noise) ** 2).mean(dim=1, keepdim=True) * counted
    return wrong.sum(dim=(1, 2, 3)) / counted.sum(dim=(1, 2, 3)).clamp(min=1)


def _step(run: _Run, drawn_from: Samples, settings: Settings, seed: int, step: int) -> float:
    run.optimizer.zero_grad()
    total = 0.0
    for batch in draw(
        drawn_from,
        step=step,
        count=settings.batch,
        at_once=settings.at_once,
        crop_px=settings.crop_px,
        seed=seed,
        multiple=run.model.multiple,
        where=run.model.text.device,
    ):
        mean = loss(run.model, batch, seed=seed).sum() / settings.batch
        mean.backward()
        total += mean.item()
    if not math.isfinite(total):
        remedy = f"Stopped at batch {step}: look at its inputs, or lower the rate."
        raise refuse("loss", "must be a finite number", total, remedy)
    run.optimizer.step()
    return total


def _noise(numbers: Sequence[int], model: Model, like: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """Times (b,) and noise (b, 4, h, w), each sample's of its own."""
    times, noises = [], []
    for number in numbers:
        rng = generator(seed, number, "completion", "noise")
        times.append(int(rng.integers(model.scheduler.config["num_train_timesteps"])))
        noises.append(rng.standard_normal(like.shape[1:]).astype(np.float32))
    return torch.tensor(times).to(like.device), torch.from_numpy(np.stack(noises)).to(like.device)


def _save(run: _Run, folder: Path, identity: str) -> None:
    # The curve first: a kill in between leaves it too long, and going on writes it anew.
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
        rule = "must be of this training, with the same samples, weights, settings and seed"
        raise refuse("checkpoint", rule, content["identity"], "Choose an empty folder.")
    checkpoint.restore(run.model.conditioning.networks, content["networks"])
    run.optimizer.load_state_dict(content["optimizer"])
    run.step, run.curve = content["step"], content["curve"]


def _of(parts: Weights) -> str:
    """Tell weights from others by their last layer."""
    layer: nn.Module = parts.unet.conv_out
    values = next(layer.parameters()).detach().cpu().numpy()
    return f"{zlib.crc32(np.ascontiguousarray(values).data):08x}"
