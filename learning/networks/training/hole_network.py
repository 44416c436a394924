"""Training of any network that predicts logits of no depth."""

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
from starling.learning.networks.training.channels import ODD, channels, names, uninformative
from starling.learning.networks.training.learner import HoleLearner, initialised
from starling.learning.networks.training.loop import train
from starling.learning.networks.training.settings import TrainingSettings
from starling.sim.console import progress


def fit_hole_network(
    examples: Sequence[Example],
    build: Callable[[float], nn.Module],
    settings: TrainingSettings,
    *,
    name: str,
    with_reflectance: bool,
    with_physics: bool,
    folder: Path,
    seed: int,
    track: progress.Progress,
) -> nn.Module:
    """Train, or continue from the folder's checkpoint, and save the weights there.

    Args:
        examples: at least one.
        build: makes the network from the share of holes, 0 to 1.
        settings: steps, batches and learning rates.
        name: name of the method.
        with_reflectance: whether the smoothed infrared image is an input.
        with_physics: whether the simulation is an input.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of initial weights and crops.
        track: wraps long loops.

    Raises:
        InputError: see `collect` and `train`; and `weights.load` for initial weights.
    """
    inputs = names(with_reflectance=with_reflectance, with_physics=with_physics)
    samples = drawing.collect(
        examples,
        partial(channels, with_reflectance=with_reflectance, with_physics=with_physics),
        odd=tuple(inputs.index(channel) for channel in ODD),
        target=_ndp,
        track=track,
    )
    share = drawing.share(samples)
    if with_physics:
        hideable = uninformative(share, with_reflectance=with_reflectance)
        samples = [dataclasses.replace(sample, hideable=hideable) for sample in samples]
    network = initialised(partial(build, share), seed)
    if settings.start is not None:
        weights.load(settings.start, name, network, inputs)
        network.requires_grad_(True).train()
    trained = train(
        HoleLearner(network, settings),
        drawing.Crops(samples=samples, settings=settings, seed=seed),
        settings,
        kind=f"{name} training",
        folder=folder,
        track=track,
    )["holes"]
    weights.save(folder, name, trained, inputs, examples[0].info.shape)
    return trained


def _ndp(example: Example) -> Mask:
    return np.asarray(example.ndp)
