"""Frames to learn from, and the crops drawn from them."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from starling.learning.completion.data.window import around
from starling.learning.completion.frame import Image, Mask, checked
from starling.learning.completion.small.false_islands import with_false_islands
from starling.learning.completion.small.seen import Seen, seen
from starling.learning.completion.small.settings import Settings
from starling.learning.networks.training import turns
from starling.patterns.errors import refuse
from starling.sim.randomness import generator

_HALVED = 0.5  # Share of crops that are seen at half the resolution.
_GAMMA = (0.6, 1.6)  # Of the image: other cameras' curves, and infrared beside colour.
_LEAST = 0.2  # Share of a crop that must have depth; else another place is drawn,
_TRIES = 10  # so often.

Window = tuple[slice, slice]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sample:
    """One frame whose truth is known."""

    image: NDArray[Any]  # (h, w) or (h, w, 3)
    depth_m: Image  # (h, w) the camera's own [m], NaN = none.
    truth_m: Image  # (h, w) [m], NaN where unknown.


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Crops of one step; depths as logarithms, 0 at each crop's median."""

    channels: Tensor  # (b, `CHANNELS`, h, w)
    proposed: Tensor  # (b, `NAMES`, h, w)
    given: Tensor  # (b, 1, h, w)
    valid: Tensor  # (b, 1, h, w), 1 where the camera has depth.
    truth: Tensor  # (b, 1, h, w), 0 where unknown.
    known: Tensor  # (b, 1, h, w), 1 where the truth is known.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Crops:
    """What the steps of a training draw from; frames come in turn, in an order of each turn's."""

    samples: Sequence[Sample]
    settings: Settings
    seed: int

    def __post_init__(self) -> None:
        if not self.samples:
            raise refuse("frames", "must be at least one", 0, "Give captures with truth.png.")
        sizes = {one.depth_m.shape for one in self.samples}
        least = tuple(min(side) for side in zip(*sizes, strict=True))
        cut = tuple(map(min, least, self.settings.crop_px))
        if len(sizes) > 1 and cut != self.settings.crop_px:
            rule = "must be of one size where some are smaller than a crop"
            raise refuse("frames", rule, sorted(sizes), "Leave out the smaller ones.")

    @property
    def identity(self) -> str:
        """Text that changes when what is drawn does."""
        digest = 0
        for sample in self.samples:
            for array in (sample.image, sample.depth_m, sample.truth_m):
                digest = zlib.crc32(np.ascontiguousarray(array).data, digest)
        return f"{self.settings} seed {self.seed} data {digest:08x}"

    def batch(self, step: int, part: str) -> Batch:
        """Crops of a step."""
        rng = generator(self.seed, step, "completion", part)
        count = self.settings.batch
        crops = []
        for place in range(step * count, (step + 1) * count):
            named = ("completion", f"{part} order")
            number = turns.chosen(place, len(self.samples), self.seed, *named)
            crops.append(self._crop(self.samples[number], rng))
        return _batch(crops)

    def _crop(self, sample: Sample, rng: np.random.Generator) -> tuple[Seen, Image]:
        """A crop as it is seen, and its truth."""
        height, width = sample.depth_m.shape
        rows, columns = self.settings.crop_px
        step = 2 if rng.random() < _HALVED and height >= 2 * rows and width >= 2 * columns else 1
        window = _tried(sample.depth_m, (step * rows, step * columns), step, rng)
        if window is None:
            step, window = 1, _around(sample.depth_m, (rows, columns))
        truth_m = sample.truth_m[window]
        depth_m = with_false_islands(sample.depth_m[window], truth_m, rng)[::step, ::step]
        image = _smaller(sample.image[window], step)
        valid: Mask = np.isfinite(depth_m)
        frame = checked(image, depth_m, valid)
        rgb = frame.rgb ** np.float32(rng.uniform(*_GAMMA))
        found = seen(dataclasses.replace(frame, rgb=rgb))
        return found, np.log(truth_m[::step, ::step] / np.float32(found.median_m))


def _tried(
    depth_m: Image, shape: tuple[int, int], step: int, rng: np.random.Generator
) -> Window | None:
    """A place of a crop that has depth enough; the best tried of a frame that hardly has any, and
    None where that is none at all.
    """
    best, most = None, 0.0
    for _ in range(_TRIES):
        window = _window(
            [
                _begun(rng, whole, min(part, whole))
                for whole, part in zip(depth_m.shape, shape, strict=True)
            ],
            shape,
        )
        known = np.isfinite(depth_m[window])
        share = float(known.mean())
        if share > most and known[::step, ::step].any():
            best, most = window, share
        if share > _LEAST:
            break
    return best


def _around(depth_m: Image, shape: tuple[int, int]) -> Window:
    """The place of a crop that has the first pixel with depth in its middle, or near it."""
    at = np.argwhere(np.isfinite(depth_m))[0]
    begun = [
        around(int(middle), part, whole)
        for middle, part, whole in zip(at, shape, depth_m.shape, strict=True)
    ]
    return _window(begun, shape)


def _window(begun: Sequence[int], shape: tuple[int, int]) -> Window:
    rows, columns = (slice(at, at + part) for at, part in zip(begun, shape, strict=True))
    return rows, columns


def _begun(rng: np.random.Generator, whole: int, part: int) -> int:
    """Where a crop begins along one side.

    Every pixel is in equally many crops, but that those which would reach beyond the image are
    moved back into it: a stereo camera's largest hole is a band along the image's left border,
    which crops that begin anywhere alike would hardly ever see.
    """
    begin = int(rng.integers(-part + 1, whole))
    return min(max(begin, 0), whole - part)


def _smaller(image: NDArray[Any], step: int) -> NDArray[Any]:
    if step == 1:
        return image
    height, width = image.shape[:2]
    size = (-(-width // step), -(-height // step))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), image.dtype)


def _batch(crops: Sequence[tuple[Seen, Image]]) -> Batch:
    def stacked(arrays: Sequence[NDArray[Any]]) -> Tensor:
        return torch.from_numpy(np.stack(arrays).astype(np.float32))

    views = [view for view, _ in crops]
    known = [np.isfinite(truth) for _, truth in crops]
    return Batch(
        channels=stacked([view.channels for view in views]),
        proposed=stacked([view.proposed for view in views]),
        given=stacked([view.given for view in views])[:, None],
        valid=stacked([view.valid for view in views])[:, None],
        truth=stacked([np.nan_to_num(truth) for _, truth in crops])[:, None],
        known=stacked(known)[:, None],
    )
