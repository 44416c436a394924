"""Frames whose whole depth is known, and the batches drawn from them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from learning.completion.diffusion.seen import Seen, look, padded
from learning.completion.diffusion.span import Span
from learning.completion.frame import Frame, Image
from learning.training import turns
from patterns.errors import refuse


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A frame and what should come out."""

    frame: Frame
    truth_m: Image  # (h, w) z [m], NaN where not known.


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Some samples on the device."""

    seen: Seen
    truth: Tensor  # (b, 1, h, w) as the sensor's `Span` encodes it.
    unknown: Tensor  # (b, 1, h, w) 1 where the truth is not known, and beyond the edge.
    numbers: tuple[int, ...]  # Which drawn samples these are since training began.


def digest(samples: Sequence[Sample]) -> str:
    """Text that changes with their number, the first or the last; reading all takes too long."""
    value = 0
    for sample in (samples[0], samples[-1]):
        for array in (sample.frame.rgb, sample.frame.depth_m, sample.truth_m):
            value = zlib.crc32(np.ascontiguousarray(array).data, value)
    return f"{len(samples)} {value:08x}"


def draw(
    samples: Sequence[Sample],
    *,
    step: int,
    count: int,
    at_once: int,
    seed: int,
    multiple: int,
    where: torch.device,
) -> Iterator[Batch]:
    """Draw the samples of a step, some at a time: equal arguments give equal ones.

    Samples come in turn, in an order that is shuffled each time round.

    Raises:
        InputError: if one lacks sensor depth, or its truth or it have another size.
    """
    numbers = range(step * count, (step + 1) * count)
    for first in range(0, count, at_once):
        some = tuple(numbers[first : first + at_once])
        drawn = []
        for number in some:
            chosen = turns.chosen(number, len(samples), seed, "completion", "order")
            sample = samples[chosen]
            shape = drawn[0].frame.shape if drawn else sample.frame.shape
            _check(sample, shape, chosen)
            drawn.append(sample)
        yield _batch(drawn, some, multiple, where)


def _batch(
    drawn: Sequence[Sample], numbers: tuple[int, ...], multiple: int, where: torch.device
) -> Batch:
    truth, unknown = [], []
    for sample in drawn:
        height, width = sample.frame.shape
        encoded = Span.of(sample.frame).encoded(sample.truth_m)
        truth.append(padded(encoded[None], multiple))
        hidden = np.ones(truth[-1].shape, np.float32)
        hidden[:, :height, :width] = np.isnan(sample.truth_m)
        unknown.append(hidden)
    return Batch(
        look([sample.frame for sample in drawn], multiple=multiple, where=where),
        torch.from_numpy(np.stack(truth)).to(where),
        torch.from_numpy(np.stack(unknown)).to(where),
        numbers,
    )


def _check(sample: Sample, shape: tuple[int, int], number: int) -> None:
    frame = sample.frame
    if sample.truth_m.shape != frame.shape or frame.shape != shape:
        got = f"{frame.shape}, truth {sample.truth_m.shape}, in sample {number}"
        raise refuse("samples", f"must all have one size, {shape}", got, "Crop them alike.")
    if not frame.valid.any():
        advice = "Leave it out: nothing tells its scale."
        raise refuse("samples", "must have sensor depth", f"none in sample {number}", advice)
