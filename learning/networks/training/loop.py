"""The loop all networks are trained in: steps, averages, and going on after a kill.

What a step draws depends on the seed and its number alone, so training that was killed goes on from
its last checkpoint to the very same bits, on one machine with one number of threads.
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


_Some = TypeVar("_Some", covariant=True)


class Lot(Protocol[_Some]):
    """What the steps of a training draw from: equal arguments give equal portions.

    A portion is a dataclass of images (b, c, h, w).
    """

    @property
    def identity(self) -> str:
        """Text that changes when what is drawn does."""
        ...

    def batch(self, step: int, part: str) -> _Some:
        """What one part of a step learns from."""
        ...


@dataclass(slots=True)
class _Run:
    """Where a training stands."""

    averaged: nn.ModuleDict  # Running average of the weights: what is used in the end.
    step: int = 0
    curve: list[dict[str, float]] = field(default_factory=list)


def train(
    learner: Learner[Any],
    lot: Lot[Any],
    settings: Schedule,
    *,
    kind: str,
    folder: Path,
    track: progress.Progress = progress.silent,
) -> nn.ModuleDict:
    """Train to the end, or go on where `folder`'s checkpoint stands.

    The weights given back are averages over the last steps (Polyak and Juditsky, SIAM J. Control
    Optim. 1992).

    Args:
        learner: freshly initialised, for portions as the lot has them.
        lot: what is learnt from.
        settings: how long.
        kind: the method, which the checkpoint is marked with.
        folder: gets `training.pt` and `loss.csv`.
        track: wraps the loop over steps.

    Returns:
        The averaged networks, ready for use.

    Raises:
        InputError: if a loss is no number (says at which batch), or the checkpoint is damaged or
            of another training.
    """
    run = _Run(copy.deepcopy(learner.networks).requires_grad_(False))
    identity = lot.identity
    path = folder / CHECKPOINT
    if path.exists():
        _resume(run, learner, checkpoint.load(path, kind), identity)
    save = partial(_save, run, learner, folder=folder, kind=kind, identity=identity)
    steps = range(run.step, settings.steps)
    for step in track(steps, f"train {kind}"):
        _step(run, learner, lot, settings, step)
        run.step = step + 1
        if run.step % settings.save_every == 0:
            save()
    if steps:
        save()
    return run.averaged.eval()


def _step(run: _Run, learner: Learner[Any], lot: Lot[Any], settings: Schedule, step: int) -> None:
    where = next(learner.networks.parameters()).device

    def draw(part: str) -> Any:
        return _moved(lot.batch(step, part), where)

    losses = learner.update(draw, step)
    for name, value in losses.items():
        _check_number(name, value, step)
    # Young averages forget faster: the first weights say nothing.
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


def _moved(portion: Any, where: torch.device) -> Any:
    """The same on a device, with the memory layout that convolutions like."""
    images = [getattr(portion, one.name) for one in fields(portion)]
    layout = torch.channels_last
    return type(portion)(*(one.to(device=where, memory_format=layout) for one in images))


def _save(run: _Run, learner: Learner[Any], *, folder: Path, kind: str, identity: str) -> None:
    # The curve first: a kill in between leaves it too long, and going on writes it anew.
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
        rule = "must be of this training, with the same scenes, settings and seed"
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
