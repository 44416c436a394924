"""Fitting a network that gives logits of no depth, whatever it is built of."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from torch import nn

from starling.learning.data.example import Example, Mask
from starling.learning.networks.training import samples as drawing
from starling.learning.networks.training import weights
from starling.learning.networks.training.channels import ODD, channels, names, saying_nothing
from starling.learning.networks.training.learner import HoleLearner, initialised
from starling.learning.networks.training.loop import train
from starling.learning.networks.training.settings import Settings
from starling.sim.console import progress


def fit_hole_network(
    examples: Sequence[Example],
    build: Callable[[float], nn.Module],
    settings: Settings,
    *,
    name: str,
    with_reflectance: bool,
    with_physics: bool,
    folder: Path,
    seed: int,
    track: progress.Progress,
) -> nn.Module:
    """Learn, or go on with what lies in the folder, and leave the weights there.

    Args:
        examples: at least one.
        build: makes the network from the share of holes, 0 to 1.
        settings: steps, batches and rates.
        name: the method's.
        with_reflectance: whether it sees the smoothed infrared image.
        with_physics: whether it sees the simulator's answers.
        folder: gets checkpoint, loss curve and weights.
        seed: fixes first weights and crops.
        track: wraps loops that take long.

    Raises:
        InputError: as `starling.learning.networks.training.samples.collect`, `starling.learning.networks.training.loop.train`, and
            `starling.learning.networks.training.weights.load` of weights to start from.
    """
    seen = names(with_reflectance=with_reflectance, with_physics=with_physics)
    samples = drawing.collect(
        examples,
        partial(channels, with_reflectance=with_reflectance, with_physics=with_physics),
        odd=tuple(seen.index(channel) for channel in ODD),
        wanted=_ndp,
        track=track,
    )
    share = drawing.share(samples)
    if with_physics:
        hideable = saying_nothing(share, with_reflectance=with_reflectance)
        samples = [dataclasses.replace(sample, hideable=hideable) for sample in samples]
    network = initialised(partial(build, share), seed)
    if settings.start is not None:
        weights.load(settings.start, name, network, seen)
        network.requires_grad_(True).train()
    learnt = train(
        HoleLearner(network, settings),
        drawing.Crops(samples=samples, settings=settings, seed=seed),
        settings,
        kind=f"{name} training",
        folder=folder,
        track=track,
    )["holes"]
    weights.save(folder, name, learnt, seen, examples[0].info.shape)
    return learnt


def _ndp(example: Example) -> Mask:
    return np.asarray(example.ndp)
