"""The batches that training draws from samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from starling.learning.completion.diffusion.crop import cropped
from starling.learning.completion.diffusion.samples import Sample, Samples
from starling.learning.completion.diffusion.seen import Seen, common, look, padded
from starling.learning.completion.diffusion.span import Span
from starling.learning.networks.training import turns
from starling.patterns.errors import refuse
from starling.sim.randomness import generator


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Some samples on the device."""

    seen: Seen
    truth: Tensor  # (b, 1, h, w) as the sensor's `Span` encodes it.
    unknown: Tensor  # (b, 1, h, w) 1 where the truth is not known, and beyond the edge.
    numbers: tuple[int, ...]  # Which drawn samples these are since training began.


def draw(
    samples: Samples,
    *,
    step: int,
    count: int,
    at_once: int,
    crop_px: tuple[int, int],
    seed: int,
    multiple: int,
    where: torch.device,
) -> Iterator[Batch]:
    """Draw the samples of a step, some at a time: equal arguments give equal ones.

    Samples come in turn, in an order that is shuffled each time round, each cropped somewhere else
    each time. Those of unequal sizes are made as large as the largest beside them, by their edges,
    where no truth is known.

    Raises:
        InputError: if one lacks sensor depth, or its truth has another size.
    """
    numbers = range(step * count, (step + 1) * count)
    for first in range(0, count, at_once):
        some = tuple(numbers[first : first + at_once])
        drawn = []
        for number in some:
            place = turns.chosen(number, len(samples), seed, "completion", "order")
            sample = samples[place]
            _check(sample, place)
            drawn.append(cropped(sample, crop_px, generator(seed, number, "completion", "crop")))
        yield _batch(drawn, some, multiple, where)


def _batch(
    drawn: Sequence[Sample], numbers: tuple[int, ...], multiple: int, where: torch.device
) -> Batch:
    truth, unknown = [], []
    largest = common([sample.frame.shape for sample in drawn])
    for sample in drawn:
        height, width = sample.frame.shape
        encoded = Span.of(sample.frame).encoded(sample.truth_m)
        truth.append(padded(encoded[None], multiple, largest))
        hidden = np.ones(truth[-1].shape, np.float32)
        hidden[:, :height, :width] = np.isnan(sample.truth_m)
        unknown.append(hidden)
    return Batch(
        look([sample.frame for sample in drawn], multiple=multiple, where=where),
        torch.from_numpy(np.stack(truth)).to(where),
        torch.from_numpy(np.stack(unknown)).to(where),
        numbers,
    )


def _check(sample: Sample, number: int) -> None:
    frame = sample.frame
    if sample.truth_m.shape != frame.shape:
        got = f"{frame.shape} and {sample.truth_m.shape} in sample {number}"
        raise refuse("frame and truth", "must have one size", got, "Take one view's.")
    if not frame.valid.any():
        advice = "Leave it out: nothing tells its scale."
        raise refuse("samples", "must have sensor depth", f"none in sample {number}", advice)
