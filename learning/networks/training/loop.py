"""The training loop of all networks: steps, weight averages, checkpoints.

The draw of a step depends on the seed and the step's number only. Training that was interrupted
continues from its last checkpoint with bit-identical results on one machine and thread count.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from torch import nn

from starling.learning.networks import checkpoint
from starling.learning.networks.training.learner import Learner
from starling.learning.networks.training.settings import Schedule
from starling.patterns.errors import refuse
from starling.sim.console import output, progress

CHECKPOINT = "training.pt"
CURVE = "loss.csv"


_Batch = TypeVar("_Batch", covariant=True)


class BatchSource(Protocol[_Batch]):
    """Source of batches. Equal arguments give equal batches.

    A batch is a dataclass of images (b, c, h, w).
    """

    @property
    def identity(self) -> str:
        """Text that changes when the drawn data change."""
        ...

    def batch(self, step: int, part: str) -> _Batch:
        """Draw the batch of one part of a step."""
        ...


@dataclass(slots=True)
class _Run:
    """State of a training run."""

    averaged: nn.ModuleDict  # Running average of the weights, the result of training.
    step: int = 0
    curve: list[dict[str, float]] = field(default_factory=list)


def train(
    learner: Learner[Any],
    batches: BatchSource[Any],
    settings: Schedule,
    *,
    kind: str,
    folder: Path,
    track: progress.Progress = progress.silent,
) -> nn.ModuleDict:
    """Train to the end, or continue from the checkpoint in `folder`.

    The returned weights are averages over the last steps (Polyak and Juditsky, SIAM J. Control
    Optim. 1992).

    Args:
        learner: freshly initialised.
        batches: source of batches.
        settings: steps and averaging.
        kind: name of the training, stored in the checkpoint.
        folder: gets `training.pt` and `loss.csv`.
        track: wraps the loop over steps.

    Returns:
        The averaged networks.

    Raises:
        InputError: if a loss is not finite (the message names the batch), or the checkpoint is
            damaged or of another training.
    """
    run = _Run(copy.deepcopy(learner.networks).requires_grad_(False))
    identity = batches.identity
    path = folder / CHECKPOINT
    if path.exists():
        _resume(run, learner, checkpoint.load(path, kind), identity)
    save = partial(_save, run, learner, folder=folder, kind=kind, identity=identity)
    steps = range(run.step, settings.steps)
    for step in track(steps, f"train {kind}"):
        _step(run, learner, batches, settings, step)
        run.step = step + 1
        if run.step % settings.save_every == 0:
            save()
    if steps:
        save()
    return run.averaged.eval()


def _step(
    run: _Run, learner: Learner[Any], batches: BatchSource[Any], settings: Schedule, step: int
) -> None:
    target = next(learner.networks.parameters()).device

    def draw(part: str) -> Any:
        return _to_device(batches.batch(step, part), target)

    losses = learner.update(draw, step)
    for name, value in losses.items():
        _check_number(name, value, step)
    # The average forgets faster at first, because the initial weights are arbitrary.
    keep = min(settings.averaging, (1 + step) / (10 + step))
    with torch.no_grad():
        pairs = zip(run.averaged.parameters(), learner.networks.parameters(), strict=True)
        for mean, value in pairs:
            mean.lerp_(value, 1 - keep)
    run.curve.append({"step": float(step), **losses})


def _check_number(name: str, value: float, step: int) -> None:
    if not math.isfinite(value):
        remedy = f"Stopped at batch {step}: look at its inputs, or lower the rate."
        raise refuse(f"loss {name}", "must be a finite number", value, remedy)


def _to_device(batch: Any, target: torch.device) -> Any:
    """Copy a batch to a device, in the memory layout that is fast for convolutions."""
    images = [getattr(batch, image.name) for image in fields(batch)]
    layout = torch.channels_last
    return type(batch)(*(image.to(device=target, memory_format=layout) for image in images))


def _save(run: _Run, learner: Learner[Any], *, folder: Path, kind: str, identity: str) -> None:
    # Write the curve first: after a kill in between, resumed training overwrites its last lines.
    output.write_file(folder / CURVE, _csv(run.curve).encode(), force=True)
    content = learner.state() | {
        "identity": identity,
        "averaged": run.averaged.state_dict(),
        "step": run.step,
        "curve": run.curve,
    }
    checkpoint.save(folder / CHECKPOINT, kind, content)


def _resume(run: _Run, learner: Learner[Any], content: dict[str, Any], identity: str) -> None:
    if content["identity"] != identity:
        rule = "must belong to this training, with the same scenes, settings and seed"
        remedy = "Choose an empty folder."
        raise refuse("checkpoint", rule, content["identity"], remedy)
    checkpoint.restore(learner.networks, content["networks"])
    checkpoint.restore(run.averaged, content["averaged"])
    for optimizer, state in zip(learner.optimizers, content["optimizers"], strict=True):
        optimizer.load_state_dict(state)
    for name in ("step", "curve"):
        setattr(run, name, content[name])


def _csv(curve: Sequence[dict[str, float]]) -> str:
    lines = [",".join(curve[0])]
    lines += [",".join(f"{value:.9g}" for value in row.values()) for row in curve]
    return "\n".join(lines) + "\n"
