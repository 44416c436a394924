"""Scenes to learn from, and the batches of crops drawn from them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from starling.learning.data.example import Example, Image, Mask
from starling.learning.data.learnable import check_learnable, known_holes
from starling.learning.networks.training import turns
from starling.learning.networks.training.channels import check_size
from starling.learning.networks.training.settings import Settings
from starling.patterns.errors import refuse
from starling.sim.console import progress
from starling.sim.randomness import generator

# Pixels this near a cut through the image do not count, as their neighbours are missing; at most a
# quarter of the crop.
CUT_PX = 32


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sample:
    """What is seen of a scene and what should come out."""

    scene: str
    room: str
    seen: Image  # (c, h, w)
    odd: tuple[int, ...]  # Channels of `seen` that change sign upside down.
    target: Image  # (h, w)
    counted: Mask  # (h, w)
    hideable: tuple[tuple[int, float], ...] = ()  # Channels, and the value that says nothing.


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Crops of one step."""

    seen: Tensor  # (b, c, h, w)
    target: Tensor  # (b, 1, h, w)
    counted: Tensor  # (b, 1, h, w), 1 where the target counts, else 0.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Crops:
    """What the steps of a training draw from."""

    samples: Sequence[Sample]  # At least one.
    settings: Settings
    seed: int  # Fixes all crops.

    @property
    def identity(self) -> str:
        """Text that changes when what is drawn does."""
        return f"{self.settings} seed {self.seed} data {digest(self.samples):08x}"

    def batch(self, step: int, part: str) -> Batch:
        """Crops of a step, for one part of it."""
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
    wanted: Callable[[Example], NDArray],
    track: progress.Progress = progress.silent,
) -> list[Sample]:
    """Make samples of all examples.

    Args:
        examples: scenes whose holes are known, all of one size.
        see: gives the channels (c, h, w).
        odd: the channels that change sign upside down.
        wanted: gives the target (h, w).
        track: wraps the loop over examples.

    Raises:
        InputError: if nothing can be learnt from them (`starling.learning.data.learnable`), they differ in size,
            or one lacks what is to be seen of it.
    """
    check_learnable(examples)
    samples = []
    for example in track(examples, "channels"):
        check_same_size(example, examples[0].info.shape)
        seen = see(example)
        ndp, counted = known_holes(example)
        check_size(example.info, "ndp", ndp)
        samples.append(
            Sample(
                scene=example.scene,
                room=example.room,
                seen=seen,
                odd=odd,
                target=wanted(example).astype(np.float32),
                counted=counted,
            )
        )
    return samples


def check_same_size(example: Example, shape: tuple[int, int]) -> None:
    """Refuse a scene of another size than those learnt from, whose patterns have other sizes too.

    Raises:
        InputError: if it has.
    """
    if example.info.shape != shape:
        rule = f"must have the size learnt from, {shape[1]}x{shape[0]}"
        found = f"{example.info.width}x{example.info.height} in {example.scene}"
        raise refuse("example", rule, found, "Keep to one resolution, or train for this one.")


def share(samples: Sequence[Sample]) -> float:
    """Mean of the targets over the counted pixels, each scene with equal weight."""
    means = [float(one.target[one.counted].mean()) for one in samples if one.counted.any()]
    return float(np.mean(means))


def digest(samples: Sequence[Sample]) -> int:
    """Number that changes when anything of the samples does."""
    value = 0
    for sample in samples:
        name = f"{sample.scene} {sample.room} {sample.odd} {sample.hideable}"
        value = zlib.crc32(name.encode(), value)
        for array in (sample.seen, sample.target, sample.counted):
            value = zlib.crc32(np.ascontiguousarray(array).data, value)
    return value


def draw(
    samples: Sequence[Sample],
    *,
    count: int,
    crop_px: tuple[int, int],
    hidden: float,
    seed: int,
    step: int,
    part: str,
) -> Batch:
    """Draw the crops of a step: equal arguments give equal crops, whatever came before.

    Scenes come in turn, in an order that is shuffled each time round, so that each weighs the same.
    Half of the crops are turned upside down. They are never mirrored: the right imager stays on
    the right. Nor is depth scaled: disparity would have to follow, and the holes with it.

    In a share `hidden` of the crops the channels that may be hidden say nothing, all together: so
    the others are learnt from as if alone (Neverova et al., ModDrop, PAMI 2016).
    """
    rng = generator(seed, step, "training", part)
    hide = generator(seed, step, "training", f"{part} hidden").random(count) < hidden
    crops = []
    for place, hides in enumerate(hide, start=step * count):
        number = turns.chosen(place, len(samples), seed, "training", f"{part} order")
        crops.append(_crop(samples[number], crop_px, hides, rng))
    return _batch(crops)


def _crop(
    sample: Sample, crop_px: tuple[int, int], hides: bool, rng: np.random.Generator
) -> tuple[Image, Image, Mask]:
    height, width = sample.target.shape
    rows, columns = (min(*pair) for pair in zip(crop_px, (height, width), strict=True))
    top = int(rng.integers(height - rows + 1))
    left = int(rng.integers(width - columns + 1))
    window = slice(top, top + rows), slice(left, left + columns)
    counted = sample.counted[window].copy()
    above, beside = min(CUT_PX, rows // 4), min(CUT_PX, columns // 4)
    counted[: above if top else 0] = False
    counted[rows - (above if top + rows < height else 0) :] = False
    counted[:, : beside if left else 0] = False
    counted[:, columns - (beside if left + columns < width else 0) :] = False
    seen, target = sample.seen[:, *window], sample.target[window]
    if rng.random() < 0.5:
        seen, target, counted = seen[:, ::-1].copy(), target[::-1], counted[::-1]
        seen[list(sample.odd)] *= -1
    if hides and sample.hideable:
        seen = seen.copy()
        for channel, value in sample.hideable:
            seen[channel] = value
    return seen, target, counted


def _batch(crops: Sequence[tuple[Image, Image, Mask]]) -> Batch:
    def stacked(arrays: Sequence[NDArray]) -> Tensor:
        return torch.from_numpy(np.stack(arrays, dtype=np.float32))

    seen, target, counted = zip(*crops, strict=True)
    return Batch(stacked(seen), stacked(target)[:, None], stacked(counted)[:, None])
