"""Training frames of the compact network, and the crops drawn from them."""

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

from starling.learning.completion.data.training_frame import window_start
from starling.learning.completion.method import Image, Mask, make_frame
from starling.learning.completion.small.network import SmallInput, small_input
from starling.learning.networks.samples import sample_at
from starling.learning.networks.training import Schedule, settings_identity
from starling.patterns.errors import refuse
from starling.sim.datasets.draw import Range
from starling.sim.randomness import generator


@dataclass(frozen=True, kw_only=True, slots=True)
class SmallSettings(Schedule):
    """Training settings. The defaults take less than half an hour on one processor core."""

    steps: int = 1500
    crop_px: tuple[int, int] = (256, 384)
    weight_decay: float = 1e-3
    averaging: float = 0.995
    save_every: int = 100


_ISLAND_SHARE = 0.8  # Share of crops with islands.
_MOST_ISLANDS = 6  # Most islands a crop.
_WIDE_PX = 8  # Least width of a stretch of a hole with an island [px].
# Area of an ellipse before it is cut by the hole [px].
_AREA_PX = Range(low=40.0, high=2500.0, log=True)
_ELONGATION = 3.0  # Greatest ratio of the axes.
_FARTHER = 0.75  # Share of islands that are too far away; the others are too near.
_OFF = (0.1, 3.3)  # Range of the error of a far island, as natural logarithm of depth.
_NEARER = 1.2  # Greatest error of a near island, as natural logarithm of depth.
_SLOPE = 0.05  # Standard deviation of the relative change of depth across an island.
_NOISE = 0.005  # Relative noise of each pixel.
_RARE = 0.1  # Greatest area of an island over that of the camera's own depth.


def with_false_islands(depth_m: Image, truth_m: Image, rng: np.random.Generator) -> Image:
    """Add islands of false depth to holes, frequent in real captures and rare in simulated ones.

    A real stereo camera at times matches a stretch of a hole to a wrong place, smoothly and with
    confidence. This is most frequent in the band that the other imager does not see. There, the
    true match is not in the image and the remaining candidates are farther away. In five rooms of
    d415-faro such islands have 10 to 1,000 pixels and are 3 to 25 times too far away. Training must
    include them so that the network learns to reject islands.

    Args:
        depth_m: (h, w) the camera's own depth [m], NaN where missing.
        truth_m: (h, w) [m], NaN where unknown; islands are centred where it is known.
        rng: random generator of number, place, size and error of the islands.
    """
    hole = np.isnan(depth_m)
    known_count = hole.size - np.count_nonzero(hole)
    runs = _runs(hole & np.isfinite(truth_m))
    if rng.random() >= _ISLAND_SHARE or not len(runs):
        return depth_m
    out = depth_m.copy()
    for _ in range(int(rng.integers(1, _MOST_ISLANDS + 1))):
        row, begin, end = runs[rng.integers(len(runs))]
        column = rng.integers(begin, end)
        area, ratio = _AREA_PX.drawn(rng), rng.uniform(1, _ELONGATION)
        axes = np.sqrt(area / np.pi * np.array([ratio, 1 / ratio]))
        island = np.zeros(depth_m.shape, np.uint8)
        size = (float(2 * axes[0]), float(2 * axes[1]))
        centre = (float(column), float(row))
        cv2.ellipse(island, (centre, size, float(rng.uniform(0, 180))), 1, cv2.FILLED)
        island[row, column] = 1  # An ellipse thinner than a pixel may miss its centre.
        rows, columns = np.nonzero((island > 0) & hole)
        if len(rows) > _RARE * known_count:
            continue
        across = (columns - column) * rng.normal(0, _SLOPE) + (rows - row) * rng.normal(0, _SLOPE)
        off = rng.uniform(*_OFF) if rng.random() < _FARTHER else -rng.uniform(_OFF[0], _NEARER)
        log = off + across / axes.max() + rng.normal(0, _NOISE, len(rows))
        out[rows, columns] = truth_m[row, column] * np.exp(log)
    return out


def _runs(mask: Mask) -> NDArray[np.intp]:
    """Return wide stretches (row, first column, column after the last) of each row that are True.

    Islands are centred on them, so that narrow bands get as many islands as wide holes.
    """
    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, first), (_, after) = np.nonzero(steps > 0), np.nonzero(steps < 0)
    return np.column_stack([rows, first, after])[after - first >= _WIDE_PX]


_HALVED = 0.5  # Share of crops at half the resolution.
_GAMMA = (0.6, 1.6)  # Range of gamma: tone curves of other cameras, and infrared as well as colour.
_LEAST = 0.2  # Least share of a crop with depth; crops with less are drawn again.
_TRIES = 10  # Greatest number of draws of a crop.

Window = tuple[slice, slice]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FrameSample:
    """One frame with ground truth."""

    image: NDArray[Any]  # (h, w) or (h, w, 3)
    depth_m: Image  # (h, w) the camera's own depth [m], NaN where missing.
    truth_m: Image  # (h, w) [m], NaN where unknown.


@dataclass(frozen=True, slots=True, eq=False)
class SmallBatch:
    """Crops of one step. Depth is its natural logarithm, 0 at the median of each crop."""

    channels: Tensor  # (b, `CHANNELS`, h, w)
    proposed: Tensor  # (b, `PROPOSALS`, h, w)
    sensor: Tensor  # (b, 1, h, w)
    valid: Tensor  # (b, 1, h, w), 1 where the camera has depth.
    truth: Tensor  # (b, 1, h, w), 0 where unknown.
    known: Tensor  # (b, 1, h, w), 1 where the truth is known.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FrameCrops:
    """Training data. Frames come in an order that is shuffled in each epoch."""

    samples: Sequence[FrameSample]
    settings: SmallSettings
    seed: int

    def __post_init__(self) -> None:
        if not self.samples:
            raise refuse("frames", "must be at least one", 0, "Give frames with reference depth.")
        sizes = {sample.depth_m.shape for sample in self.samples}
        least = tuple(min(side) for side in zip(*sizes, strict=True))
        cut = tuple(map(min, least, self.settings.crop_px))
        if len(sizes) > 1 and cut != self.settings.crop_px:
            rule = "must be of one size where some are smaller than a crop"
            raise refuse("frames", rule, sorted(sizes), "Leave out the smaller ones.")

    @property
    def identity(self) -> str:
        """Text that changes when the drawn data change."""
        digest = 0
        for sample in self.samples:
            for array in (sample.image, sample.depth_m, sample.truth_m):
                digest = zlib.crc32(np.ascontiguousarray(array).data, digest)
        return f"{settings_identity(self.settings)} seed {self.seed} data {digest:08x}"

    def batch(self, step: int, part: str) -> SmallBatch:
        """Draw the crops of a step."""
        rng = generator(self.seed, step, "completion", part)
        count = self.settings.batch
        crops = []
        for place in range(step * count, (step + 1) * count):
            stream = ("completion", f"{part} order")
            number = sample_at(place, len(self.samples), self.seed, *stream)
            crops.append(self._crop(self.samples[number], rng))
        return _batch(crops)

    def _crop(self, sample: FrameSample, rng: np.random.Generator) -> tuple[SmallInput, Image]:
        """Draw one crop: its network input and its truth."""
        height, width = sample.depth_m.shape
        rows, columns = self.settings.crop_px
        step = 2 if rng.random() < _HALVED and height >= 2 * rows and width >= 2 * columns else 1
        window = _window_with_depth(sample.depth_m, (step * rows, step * columns), step, rng)
        if window is None:
            step, window = 1, _window_around_depth(sample.depth_m, (rows, columns))
        truth_m = sample.truth_m[window]
        depth_m = with_false_islands(sample.depth_m[window], truth_m, rng)[::step, ::step]
        image = _smaller(sample.image[window], step)
        valid: Mask = np.isfinite(depth_m)
        frame = make_frame(image, depth_m, valid)
        rgb = frame.rgb ** np.float32(rng.uniform(*_GAMMA))
        inputs = small_input(dataclasses.replace(frame, rgb=rgb))
        return inputs, np.log(truth_m[::step, ::step] / np.float32(inputs.median_m))


def _window_with_depth(
    depth_m: Image, shape: tuple[int, int], step: int, rng: np.random.Generator
) -> Window | None:
    """Draw a window with enough depth.

    Returns the best of all tries if none has enough, or None if none has any depth.
    """
    best, most = None, 0.0
    for _ in range(_TRIES):
        window = _window(
            [
                _random_start(rng, whole, min(part, whole))
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


def _window_around_depth(depth_m: Image, shape: tuple[int, int]) -> Window:
    """Return a window that has the first pixel with depth at or near its centre."""
    pixel = np.argwhere(np.isfinite(depth_m))[0]
    starts = [
        window_start(int(middle), part, whole)
        for middle, part, whole in zip(pixel, shape, depth_m.shape, strict=True)
    ]
    return _window(starts, shape)


def _window(starts: Sequence[int], shape: tuple[int, int]) -> Window:
    rows, columns = (slice(start, start + part) for start, part in zip(starts, shape, strict=True))
    return rows, columns


def _random_start(rng: np.random.Generator, whole: int, part: int) -> int:
    """Draw the start of a crop along one side.

    Starts are uniform, including crops that would reach beyond the image, which are then moved
    inside. Border pixels are thus in as many crops as others. The largest hole of a stereo camera
    is a band along the left border, which starts uniform inside the image would hardly cover.
    """
    begin = int(rng.integers(-part + 1, whole))
    return min(max(begin, 0), whole - part)


def _smaller(image: NDArray[Any], step: int) -> NDArray[Any]:
    if step == 1:
        return image
    height, width = image.shape[:2]
    size = (-(-width // step), -(-height // step))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), image.dtype)


def _batch(crops: Sequence[tuple[SmallInput, Image]]) -> SmallBatch:
    def stacked(arrays: Sequence[NDArray[Any]]) -> Tensor:
        return torch.from_numpy(np.stack(arrays).astype(np.float32))

    views = [view for view, _ in crops]
    known = [np.isfinite(truth) for _, truth in crops]
    return SmallBatch(
        channels=stacked([view.channels for view in views]),
        proposed=stacked([view.proposed for view in views]),
        sensor=stacked([view.sensor for view in views])[:, None],
        valid=stacked([view.valid for view in views])[:, None],
        truth=stacked([np.nan_to_num(truth) for _, truth in crops])[:, None],
        known=stacked(known)[:, None],
    )
