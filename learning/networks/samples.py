"""Training scenes, and the batches of crops drawn from them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from starling.learning.data.example import Example, Image, Mask, check_learnable, known_holes
from starling.learning.networks.channels import check_size
from starling.learning.networks.stored import store
from starling.learning.networks.training import TrainingSettings, settings_identity
from starling.patterns.errors import refuse
from starling.sim.console import progress
from starling.sim.randomness import generator


def sample_at(place: int, count: int, seed: int, stage: str, effect: str) -> int:
    """Return the number of the sample at a position of the endless sequence of epochs.

    Args:
        place: position since training began.
        count: number of samples.
        seed: seed of all orders.
        stage, effect: name of the random stream (see `starling.sim.randomness.generator`).
    """
    turn, position = divmod(place, count)
    return int(generator(seed, turn, stage, effect).permutation(count)[position])


# Pixels nearer than this to a cut do not count, because their neighbours are missing [px]. The
# margin is at most a quarter of the crop.
CUT_PX = 32


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneSample:
    """Input channels and target of a scene."""

    scene: str
    room: str
    inputs: Image  # (c, h, w)
    odd: tuple[int, ...]  # Channels that change sign when flipped vertically.
    target: Image  # (h, w)
    counted: Mask  # (h, w)
    # Number and uninformative value of each channel that can be hidden.
    hideable: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Crops of one step."""

    inputs: Tensor  # (b, c, h, w)
    target: Tensor  # (b, 1, h, w)
    counted: Tensor  # (b, 1, h, w), 1 where the target counts, else 0.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Crops:
    """Source of the crops of a training."""

    samples: Sequence[SceneSample]  # At least one.
    settings: TrainingSettings
    seed: int  # Seed of all crops.

    @property
    def identity(self) -> str:
        """Text that changes when the drawn data change."""
        return (
            f"{settings_identity(self.settings)} seed {self.seed} data {digest(self.samples):08x}"
        )

    def batch(self, step: int, part: str) -> Batch:
        """Draw the crops of one part of a step."""
        return draw(
            self.samples,
            count=self.settings.batch,
            crop_px=self.settings.crop_px,
            hidden=self.settings.hidden,
            seed=self.seed,
            step=step,
            part=part,
        )


def collect(
    examples: Sequence[Example],
    see: Callable[[Example], Image],
    *,
    odd: tuple[int, ...],
    target: Callable[[Example], NDArray],
    folder: Path,
    track: progress.Progress = progress.silent,
) -> Sequence[SceneSample]:
    """Make samples of all examples, stored on disk.

    Args:
        examples: scenes with known holes, all of one size.
        see: returns the input channels (c, h, w).
        odd: channels that change sign when flipped vertically.
        target: returns the target (h, w).
        folder: folder of the training (see `starling.learning.networks.stored.store`).
        track: wraps the loop over examples.

    Raises:
        InputError: if the examples cannot be learnt from (`starling.learning.data.example`),
            differ in size, or lack an input; or if the disk is full.
    """
    check_learnable(examples)
    shape = examples[0].info.shape

    def sample(example: Example) -> SceneSample:
        check_same_size(example, shape)
        inputs = see(example)
        ndp, counted = known_holes(example)
        check_size(example.info, "ndp", ndp)
        return SceneSample(
            scene=example.scene,
            room=example.room,
            inputs=inputs,
            odd=odd,
            target=target(example).astype(np.float32),
            counted=counted,
        )

    return store(map(sample, track(examples, "channels")), folder)


def check_same_size(example: Example, shape: tuple[int, int]) -> None:
    """Refuse a scene of another size than the training scenes, because patterns scale with size.

    Raises:
        InputError: if the sizes differ.
    """
    if example.info.shape != shape:
        rule = f"must have the size of the training scenes, {shape[1]}x{shape[0]}"
        got = f"{example.info.width}x{example.info.height} in {example.scene}"
        raise refuse("example", rule, got, "Keep to one resolution, or train for this one.")


def share(samples: Sequence[SceneSample]) -> float:
    """Mean of the targets over counted pixels; each scene has the same weight."""
    means = [float(item.target[item.counted].mean()) for item in samples if item.counted.any()]
    return float(np.mean(means))


def digest(samples: Sequence[SceneSample]) -> int:
    """Checksum of all samples."""
    value = 0
    for sample in samples:
        name = f"{sample.scene} {sample.room} {sample.odd} {sample.hideable}"
        value = zlib.crc32(name.encode(), value)
        for array in (sample.inputs, sample.target, sample.counted):
            value = zlib.crc32(np.ascontiguousarray(array).data, value)
    return value


def draw(
    samples: Sequence[SceneSample],
    *,
    count: int,
    crop_px: tuple[int, int],
    hidden: float,
    seed: int,
    step: int,
    part: str,
) -> Batch:
    """Draw the crops of a step. Equal arguments give equal crops.

    The order of scenes is shuffled in each epoch, so that each has the same weight. Half of the
    crops are flipped vertically. Crops are never mirrored, because the right imager is on the
    right. Depth is not scaled, because disparity and holes would change with it.

    In a share `hidden` of the crops all hideable channels are uninformative. The network thus
    learns from the other channels alone as well (Neverova et al., ModDrop, PAMI 2016).
    """
    rng = generator(seed, step, "training", part)
    hide = generator(seed, step, "training", f"{part} hidden").random(count) < hidden
    crops = []
    for place, hides in enumerate(hide, start=step * count):
        number = sample_at(place, len(samples), seed, "training", f"{part} order")
        crops.append(_crop(samples[number], crop_px, hides, rng))
    return _batch(crops)


def _crop(
    sample: SceneSample, crop_px: tuple[int, int], hides: bool, rng: np.random.Generator
) -> tuple[Image, Image, Mask]:
    height, width = sample.target.shape
    rows, columns = (min(*pair) for pair in zip(crop_px, (height, width), strict=True))
    top = int(rng.integers(height - rows + 1))
    left = int(rng.integers(width - columns + 1))
    window = slice(top, top + rows), slice(left, left + columns)
    counted = sample.counted[window].copy()
    row_margin, column_margin = min(CUT_PX, rows // 4), min(CUT_PX, columns // 4)
    counted[: row_margin if top else 0] = False
    counted[rows - (row_margin if top + rows < height else 0) :] = False
    counted[:, : column_margin if left else 0] = False
    counted[:, columns - (column_margin if left + columns < width else 0) :] = False
    inputs, target = sample.inputs[:, *window], sample.target[window]
    if rng.random() < 0.5:
        inputs, target, counted = inputs[:, ::-1].copy(), target[::-1], counted[::-1]
        inputs[list(sample.odd)] *= -1
    if hides and sample.hideable:
        inputs = inputs.copy()
        for channel, value in sample.hideable:
            inputs[channel] = value
    return inputs, target, counted


def _batch(crops: Sequence[tuple[Image, Image, Mask]]) -> Batch:
    def stacked(arrays: Sequence[NDArray]) -> Tensor:
        return torch.from_numpy(np.stack(arrays, dtype=np.float32))

    inputs, target, counted = zip(*crops, strict=True)
    return Batch(stacked(inputs), stacked(target)[:, None], stacked(counted)[:, None])
