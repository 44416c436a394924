"""The loop all networks are trained in: steps, averages, a room held out, going on after a kill.

What a step draws depends on the seed and its number alone, so training that was killed goes on from
its last checkpoint to the very same bits, on one machine with one number of threads.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import nn

from learning import checkpoint
from learning.training import samples as drawing
from learning.training.learner import Learner
from learning.training.samples import Batch, Sample
from learning.training.settings import Settings
from patterns.errors import refuse
from sim import output, progress

CHECKPOINT = "training.pt"
CURVE = "loss.csv"
Judge = Callable[[nn.ModuleDict, Batch], torch.Tensor]  # Gives the loss () of a whole image.
_HELD_OUT = "held_out"  # Column of the loss of the room held out.


@dataclass(slots=True)
class _Run:
    """Where a training stands."""

    averaged: nn.ModuleDict  # Running average of the weights: what is used in the end.
    best: dict[str, Any]  # The average's weights when the room held out liked them best.
    step: int = 0
    lowest: float = math.inf  # Its loss then.
    curve: list[dict[str, float]] = field(default_factory=list)


def train(
    learner: Learner,
    samples: Sequence[Sample],
    settings: Settings,
    *,
    kind: str,
    folder: Path,
    seed: int,
    judge: Judge | None = None,
    tell: progress.Progress = progress.silent,
) -> nn.ModuleDict:
    """Train to the end, or go on where `folder`'s checkpoint stands.

    With a judge and `settings.rooms_to_hold_out` rooms or more, one is held out, and the weights
    that the judge likes best there are given back; else those of the last step. Both are averages
    over steps (Polyak and Juditsky, SIAM J. Control Optim. 1992).

    Args:
        learner: freshly initialised.
        samples: at least one.
        settings: steps, batches and rates.
        kind: the method, which the checkpoint is marked with.
        folder: gets `training.pt` and `loss.csv`.
        seed: fixes all crops.
        judge: what the room held out is judged by, the lower the better.
        tell: wraps the loop over steps.

    Returns:
        The averaged networks, ready for use.

    Raises:
        InputError: if a loss is no number (says at which batch), or the checkpoint is damaged or
            of another training.
    """
    learnt_from, held_out = list(samples), []
    if judge and len({sample.room for sample in samples}) >= settings.rooms_to_hold_out:
        learnt_from, held_out = drawing.split(samples, seed)
    averaged = copy.deepcopy(learner.networks).requires_grad_(False)
    run = _Run(averaged, copy.deepcopy(averaged.state_dict()))
    identity = f"{settings} seed {seed} data {drawing.digest(samples):08x}"
    path = folder / CHECKPOINT
    if path.exists():
        _resume(run, learner, checkpoint.load(path, kind), identity)
    save = partial(_save, run, learner, folder=folder, kind=kind, identity=identity)
    steps = range(run.step, settings.steps)
    for step in tell(steps, f"train {kind}"):
        row = _step(run, learner, learnt_from, settings, seed, step)
        run.step = step + 1
        due = run.step % settings.validate_every == 0 or run.step == settings.steps
        if judge and held_out and due:
            row[_HELD_OUT] = _look(run, judge, held_out, step)
        if run.step % settings.save_every == 0:
            save()
    if steps:
        save()
    if held_out:
        run.averaged.load_state_dict(run.best)
    return run.averaged.eval()


def _step(
    run: _Run,
    learner: Learner,
    samples: Sequence[Sample],
    settings: Settings,
    seed: int,
    step: int,
) -> dict[str, float]:
    where = next(learner.networks.parameters()).device

    def draw(part: str) -> Batch:
        crops, count = settings.crop_px, settings.batch
        batch = drawing.draw(
            samples,
            count=count,
            crop_px=crops,
            hidden=settings.hidden,
            seed=seed,
            step=step,
            part=part,
        )
        return _moved(batch, where)

    losses = learner.update(draw, step)
    for name, value in losses.items():
        _check_number(name, value, step)
    # Young averages forget faster: the first weights say nothing.
    keep = min(settings.averaging, (1 + step) / (10 + step))
    with torch.no_grad():
        pairs = zip(run.averaged.parameters(), learner.networks.parameters(), strict=True)
        for mean, value in pairs:
            mean.lerp_(value, 1 - keep)
    row = {"step": float(step), **losses}
    run.curve.append(row)
    return row


@torch.no_grad()
def _look(run: _Run, judge: Judge, held_out: Sequence[Sample], step: int) -> float:
    """Loss of the averaged weights on the room held out, each scene with equal weight."""
    where = next(run.averaged.parameters()).device
    batches = (_moved(drawing.whole(sample), where) for sample in held_out)
    losses = [judge(run.averaged, batch).item() for batch in batches]
    loss = sum(losses) / len(losses)
    _check_number(_HELD_OUT, loss, step)
    if loss < run.lowest:
        run.lowest = loss
        run.best = copy.deepcopy(run.averaged.state_dict())
    return loss


def _check_number(name: str, value: float, step: int) -> None:
    if not math.isfinite(value):
        remedy = f"Stopped at batch {step}: look at its inputs, or lower the rate."
        raise refuse(f"loss {name}", "must be a finite number", value, remedy)


def _moved(batch: Batch, where: torch.device) -> Batch:
    def move(tensor: torch.Tensor) -> torch.Tensor:
        return tensor.to(device=where, memory_format=torch.channels_last)

    return Batch(move(batch.seen), move(batch.target), move(batch.counted))


def _save(run: _Run, learner: Learner, *, folder: Path, kind: str, identity: str) -> None:
    # The curve first: a kill in between leaves it too long, and going on writes it anew.
    output.write_file(folder / CURVE, _csv(run.curve).encode(), force=True)
    content = learner.state() | {
        "identity": identity,
        "averaged": run.averaged.state_dict(),
        "best": run.best,
        "step": run.step,
        "lowest": run.lowest,
        "curve": run.curve,
    }
    checkpoint.save(folder / CHECKPOINT, kind, content)


def _resume(run: _Run, learner: Learner, content: dict[str, Any], identity: str) -> None:
    if content["identity"] != identity:
        rule = "must be of this training, with the same scenes, settings and seed"
        remedy = "Choose an empty folder."
        raise refuse("checkpoint", rule, content["identity"], remedy)
    checkpoint.restore(learner.networks, content["networks"])
    checkpoint.restore(run.averaged, content["averaged"])
    for optimizer, state in zip(learner.optimizers, content["optimizers"], strict=True):
        optimizer.load_state_dict(state)
    for name in ("best", "step", "lowest", "curve"):
        setattr(run, name, content[name])


def _csv(curve: Sequence[dict[str, float]]) -> str:
    """The losses as text; the room held out has a value only where it was looked at."""
    names = [*curve[0], _HELD_OUT] if _HELD_OUT not in curve[0] else list(curve[0])
    lines = [",".join(names)]
    for row in curve:
        lines.append(",".join(f"{row[name]:.9g}" if name in row else "" for name in names))
    return "\n".join(lines) + "\n"
