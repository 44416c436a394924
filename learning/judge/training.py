"""Training of the judge's network on some rooms, stopped by others."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from starling.learning.judge.network import WINDOW, WindowJudge
from starling.learning.judge.samples import ScenePair, counted_windows, moments
from starling.learning.networks.device import initialised
from starling.learning.networks.training import decaying_adam, descend
from starling.sim.console import progress
from starling.sim.randomness import generator

_CERTAIN = 0.01  # Mean cross entropy below which training ends: no window is in doubt.


@dataclass(frozen=True, kw_only=True, slots=True)
class JudgeSettings:
    """Length and rate of a training; steps count pairs of whole images."""

    steps: int = 120
    pairs: int = 3  # Scenes a step, each real and simulated.
    rate: float = 3e-3
    weight_decay: float = 0.05
    averaging: float = 0.95  # Decay of the running average of weights per step.
    check_every: int = 10  # Steps between scores of the stopping rooms.
    patience: int = 5  # Checks without a better score after which training ends.


def trained(
    learn: Sequence[ScenePair],
    stop: Sequence[ScenePair],
    settings: JudgeSettings,
    *,
    seed: int,
    track: progress.Progress = progress.silent,
) -> WindowJudge:
    """Train a network, and return it at its lowest loss in the stopping rooms.

    Args:
        learn: pairs to learn from.
        stop: pairs of other rooms, which end the training.
        settings: length and rate.
        seed: seed of weights, crops and dropout.
    """
    channels = learn[0].cells.shape[2]
    network = initialised(lambda: WindowJudge(channels), seed)
    mean, scale = moments(learn)
    network.mean.copy_(mean)
    network.scale.copy_(scale)
    averaged = copy.deepcopy(network).requires_grad_(False)
    optimizer = decaying_adam(network, settings.weight_decay)
    best, lowest, since = copy.deepcopy(averaged.eval()), math.inf, 0
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for step in range(settings.steps):
            for group in optimizer.param_groups:
                group["lr"] = _rate(step, settings)
            network.train()
            descend(
                optimizer, _loss(network, _batch(learn, step, settings.pairs, seed)), steepest=1.0
            )
            _average(averaged, network, min(settings.averaging, (1 + step) / (10 + step)))
            if (step + 1) % settings.check_every == 0:
                loss = _stop_loss(averaged, stop)
                since += 1
                if loss < lowest:
                    best, lowest, since = copy.deepcopy(averaged), loss, 0
                if since >= settings.patience or lowest < _CERTAIN:
                    break
    return best.eval()


def scores(network: WindowJudge, pair: ScenePair) -> Tensor:
    """Score the windows of a pair, the mean of both flips, (2 sides, rows, columns)."""
    with torch.inference_mode():
        total = [_whole(network, pair, flip) for flip in (0, 1)]
    return torch.stack([total[0], total[1].flip(-2)]).mean(0)


def _whole(network: WindowJudge, pair: ScenePair, flip: int) -> Tensor:
    """Score one flip; upside down, the grid starts where the upright one ends."""
    rows, columns = (side // WINDOW * WINDOW for side in pair.cells.shape[-2:])
    first = (pair.cells.shape[-2] - rows) * flip
    cells = pair.cells[:, flip, :, first : first + rows, :columns]
    shown = pair.shown[flip, :, first : first + rows, :columns]
    return network(cells, shown.expand(2, -1, -1, -1))


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    cells: Tensor  # (2 b, c, rows, columns): real, then simulated.
    shown: Tensor  # (2 b, 1, rows, columns)


def _batch(samples: Sequence[ScenePair], step: int, count: int, seed: int) -> _Batch:
    """Draw scenes, a flip and the first cell of the grid of windows of each."""
    random = generator(seed, step, "judge", "batch")
    rows, columns = samples[0].cells.shape[-2:]
    # One window less than fits, so that the grid can start anywhere.
    size = [max(side // WINDOW - 1, 1) * WINDOW for side in (rows, columns)]
    spare = [side - length for side, length in zip((rows, columns), size, strict=True)]
    drawn = random.choice(len(samples), count, replace=count > len(samples))
    cells, shown = [], []
    for number in drawn:
        pair, flip = samples[number], int(random.integers(2))
        top, left = (int(random.integers(free + 1)) for free in spare)
        place = (..., slice(top, top + size[0]), slice(left, left + size[1]))
        cells.append(pair.cells[:, flip][place])
        shown.append(pair.shown[flip][place])
    known = torch.stack(shown)
    return _Batch(torch.stack(cells, 1).flatten(0, 1), torch.cat([known, known]))


def _loss(network: WindowJudge, batch: _Batch) -> Tensor:
    """Mean cross entropy of the judged windows."""
    score = network(batch.cells, batch.shown)
    real = torch.zeros_like(score)
    real[: len(score) // 2] = 1
    counted = counted_windows(batch.shown)
    losses = functional.binary_cross_entropy_with_logits(score, real, reduction="none")
    return (losses * counted).sum() / counted.sum().clamp(min=1)


def _stop_loss(network: WindowJudge, stop: Sequence[ScenePair]) -> float:
    network.eval()
    with torch.inference_mode():
        losses = []
        for pair in stop:
            rows, columns = (side // WINDOW * WINDOW for side in pair.cells.shape[-2:])
            cells = pair.cells[:, 0, :, :rows, :columns]
            shown = pair.shown[:1, :, :rows, :columns].expand(2, -1, -1, -1)
            losses.append(float(_loss(network, _Batch(cells, shown))))
    return float(np.mean(losses))


def _average(averaged: WindowJudge, network: WindowJudge, keep: float) -> None:
    with torch.no_grad():
        states = zip(averaged.state_dict().values(), network.state_dict().values(), strict=True)
        for mean, value in states:
            if value.is_floating_point():
                mean.lerp_(value, 1 - keep)


def _rate(step: int, settings: JudgeSettings) -> float:
    """Return the learning rate: linear rise, then half a cosine to 0."""
    rise = 0.1 * settings.steps
    if step < rise:
        return settings.rate * (step + 1) / (rise + 1)
    return settings.rate * 0.5 * (1 + math.cos(math.pi * (step - rise) / (settings.steps - rise)))
