"""Training data: samples with ground truth, random crops and batches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from starling.learning.completion.data.layouts import ListedFrame, fingerprint
from starling.learning.completion.data.training_frame import (
    Holes,
    none_has_depth,
    training_frame,
    window_start,
)
from starling.learning.completion.diffusion.span import (
    NetworkInput,
    Span,
    common_size,
    network_input,
    pad_edges,
)
from starling.learning.completion.method import CompletionFrame, Image
from starling.learning.networks.samples import sample_at
from starling.patterns.errors import refuse
from starling.sim.randomness import generator


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSample:
    """A frame and its ground truth."""

    frame: CompletionFrame
    truth_m: Image  # (h, w) z [m], NaN where unknown.


class TrainingSamples(Protocol):
    """A training set. Samples are read when they are drawn, so that they need not fit in memory."""

    @property
    def identity(self) -> str:
        """Text that changes when a sample changes."""
        ...

    def __len__(self) -> int:
        """Number of samples."""
        ...

    def __getitem__(self, number: int) -> TrainingSample:
        """Return one sample; the result is the same on each call."""
        ...


# Least share of a crop with sensor depth. The scale of a crop is estimated from its sensor depth.
_LEAST = 0.2
_TRIES = 10  # Random crops tried before the crop is placed around a pixel with depth.


def random_crop(
    sample: TrainingSample, size_px: tuple[int, int], rng: np.random.Generator
) -> TrainingSample:
    """Cut a random crop out of a sample. A side shorter than the crop stays whole.

    Args:
        sample: sample with sensor depth; the crop has sensor depth too.
        size_px: height and width of the crop [px].
        rng: random generator of the place.
    """
    frame = sample.frame
    rows, columns = (min(pair) for pair in zip(frame.shape, size_px, strict=True))
    if (rows, columns) == frame.shape:
        return sample
    for _ in range(_TRIES):
        top, left = (
            int(rng.integers(whole - part + 1))
            for whole, part in zip(frame.shape, (rows, columns), strict=True)
        )
        if frame.valid[top : top + rows, left : left + columns].mean() > _LEAST:
            return _cut(sample, top, left, rows, columns)
    # The frame has hardly any depth: place the crop around a random pixel that has depth.
    known = np.argwhere(frame.valid)
    row, column = known[int(rng.integers(len(known)))].tolist()
    top, left = (
        window_start(row, rows, frame.shape[0]),
        window_start(column, columns, frame.shape[1]),
    )
    return _cut(sample, top, left, rows, columns)


def _cut(sample: TrainingSample, top: int, left: int, rows: int, columns: int) -> TrainingSample:
    window = slice(top, top + rows), slice(left, left + columns)
    frame = sample.frame
    part = CompletionFrame(
        rgb=frame.rgb[window], depth_m=frame.depth_m[window], valid=frame.valid[window]
    )
    return TrainingSample(part, sample.truth_m[window])


@dataclass(frozen=True, slots=True, eq=False)
class DiffusionBatch:
    """Some samples as tensors on the device."""

    inputs: NetworkInput
    truth: Tensor  # (b, 1, h, w) as the sensor's `Span` encodes it.
    unknown: Tensor  # (b, 1, h, w) 1 where the truth is unknown, and in the padding.
    numbers: tuple[int, ...]  # Number of each sample among all samples drawn since training began.


def draw_batches(
    samples: TrainingSamples,
    *,
    step: int,
    count: int,
    at_once: int,
    crop_px: tuple[int, int],
    seed: int,
    multiple: int,
    device: torch.device,
) -> Iterator[DiffusionBatch]:
    """Draw the samples of one training step, `at_once` at a time. The draw is deterministic.

    The order of the samples is shuffled in each epoch. Each sample is cropped at a random place.
    Smaller crops are padded by their edge pixels to the largest of their batch. The truth counts
    as unknown in the padding.

    Args:
        samples: the training set.
        step: number of the step.
        count: samples a step.
        at_once: samples a batch.
        crop_px: height and width of a crop [px].
        seed: seed of the order and of the crops.
        multiple: height and width of a batch are multiples of this number [px].
        device: the device.

    Raises:
        InputError: if a sample has no sensor depth, or its truth has another size.
    """
    numbers = range(step * count, (step + 1) * count)
    for first in range(0, count, at_once):
        batch_numbers = tuple(numbers[first : first + at_once])
        crops = []
        for number in batch_numbers:
            index = sample_at(number, len(samples), seed, "completion", "order")
            sample = samples[index]
            _check(sample, index)
            crops.append(
                random_crop(sample, crop_px, generator(seed, number, "completion", "crop"))
            )
        yield _batch(crops, batch_numbers, multiple, device)


def _batch(
    crops: Sequence[TrainingSample], numbers: tuple[int, ...], multiple: int, device: torch.device
) -> DiffusionBatch:
    truth, unknown = [], []
    largest = common_size([sample.frame.shape for sample in crops])
    for sample in crops:
        height, width = sample.frame.shape
        encoded = Span.from_frame(sample.frame).encode(sample.truth_m)
        truth.append(pad_edges(encoded[None], multiple, largest))
        hidden = np.ones(truth[-1].shape, np.float32)
        hidden[:, :height, :width] = np.isnan(sample.truth_m)
        unknown.append(hidden)
    return DiffusionBatch(
        network_input([sample.frame for sample in crops], multiple=multiple, device=device),
        torch.from_numpy(np.stack(truth)).to(device),
        torch.from_numpy(np.stack(unknown)).to(device),
        numbers,
    )


def _check(sample: TrainingSample, number: int) -> None:
    """Refuse a sample that training cannot use."""
    frame = sample.frame
    if sample.truth_m.shape != frame.shape:
        got = f"{frame.shape} and {sample.truth_m.shape} in sample {number}"
        raise refuse("frame and truth", "must have one size", got, "Take one view's.")
    if not frame.valid.any():
        advice = "Leave it out: its scale is unknown."
        raise refuse("samples", "must have sensor depth", f"none in sample {number}", advice)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ListedSamples:
    """Listed frames as `TrainingSamples`. Frames do not stay in memory.

    A frame without depth is replaced by the next frame in order that has depth. The draw thus
    depends on the frames only.
    """

    frames: Sequence[ListedFrame]  # At least one, with ground truth.
    holes: Holes
    seed: int  # Seed of random holes.
    # Number of each frame read -> share of holes, 0..1.
    shares: dict[int, float] = field(default_factory=dict)

    @property
    def identity(self) -> str:
        """Text that changes with the frames, computed without reading an image.

        Raises:
            InputError: see `fingerprint`.
        """
        return f"{fingerprint(self.frames)} holes {self.holes}"

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> TrainingSample:
        """Read one sample.

        Raises:
            InputError: if a frame is invalid, or none has depth.
        """
        for index in (*range(number, len(self)), *range(number)):
            if (sample := self._read(index)) is not None:
                return sample
        raise none_has_depth(len(self))

    def _read(self, index: int) -> TrainingSample | None:
        if self.shares.get(index) == 1:
            return None
        pair = self.frames[index].load()
        prepared = training_frame(pair, self.holes, seed=self.seed, number=index)
        self.shares[index] = 1.0 if prepared is None else float(1 - prepared.valid.mean())
        return None if prepared is None else TrainingSample(prepared.frame, prepared.truth())
