"""Statistics of small cells of depth, holes and infrared images, which the judge's network reads.

Fixed filters at several scales replace the first layers of a network. Few rooms train few weights.
The rich models of steganalysis do the same (Fridrich and Kodovsky, IEEE TIFS 2012).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.arrays import Image, Mask
from starling.sim.captures.capture import Frame
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage

CELL_PX = 16  # Side of a cell.
_STEPS_PX = (1, 2, 4, 8)  # Distances of the differences.
_SMOOTHINGS_PX = (1.0, 2.0, 4.0, 8.0)  # Standard deviations of the band passes.
# Bins of absolute responses [px]; the first holds equal values of a quantised map.
_DISPARITY_EDGES_PX = (0.0, 1e-4, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0, 3.0, np.inf)
_INFRARED_EDGES = (-np.inf, -1.5, -0.8, -0.4, -0.15, 0.15, 0.4, 0.8, 1.5, np.inf)
_RUN_EDGES_PX = (1, 2, 3, 5, 9, 17, 33, 10**6)  # Lengths of runs along rows and columns.
_AREA_EDGES_PX = (1, 2, 4, 8, 16, 31, 101, 1001, 10**9)  # Areas of holes and of islands.
_NEAR_EDGES_PX = (0.5, 1.5, 2.5, 4.5, 8.5)  # Distances to the next hole.
_PATTERNS = 16  # Number of 2 x 2 patterns of a mask.
_NORMALISATION_PX = 8.0  # Standard deviation of the window of local contrast.
_DARKEST_DN = 0.25  # Added to the local contrast, so that flat areas do not become noise [DN].


def cell_means(image: Image | Mask) -> Image:
    """Average an image (h, w) over whole cells (h // 16, w // 16)."""
    rows, columns = (side // CELL_PX for side in image.shape)
    whole = np.ascontiguousarray(image[: rows * CELL_PX, : columns * CELL_PX], np.float32)
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)


def depth(frame: Frame, info: CaptureInfo) -> Iterator[Image]:
    """Yield cell statistics of disparity without its slow part, and of its holes.

    Raises:
        InputError: if the frame has no depth.
    """
    disparity_px = _disparity_px(frame, info)
    known = np.isfinite(disparity_px)
    values = np.nan_to_num(disparity_px)
    yield from _of_holes(~known)
    for response, valid in (*_differences(values, known), *_bands(values, known)):
        yield from _shares(np.abs(response), valid, _DISPARITY_EDGES_PX)
    # Noise next to holes: the matcher's filters cut holes by quality.
    distance_px = cv2.distanceTransform(known.astype(np.uint8), cv2.DIST_L2, 3)
    response, valid = next(_bands(values, known))
    for low, high in pairwise(_NEAR_EDGES_PX):
        near = valid & (distance_px > low) & (distance_px <= high)
        yield cell_means(np.where(near, np.minimum(np.abs(response), 1), 0))
        yield cell_means(near)


def holes(frame: Frame, info: CaptureInfo) -> Iterator[Image]:
    """Yield cell statistics of the no-depth mask.

    Raises:
        InputError: if the frame has no depth.
    """
    yield from _of_holes(~np.isfinite(_disparity_px(frame, info)))


def infrared(frame: Frame, info: CaptureInfo) -> Iterator[Image]:
    """Yield cell statistics of both images, whose local mean and contrast are divided out.

    Raises:
        InputError: if the frame has no infrared pair.
    """
    del info
    if frame.ir_left is None or frame.ir_right is None:
        raise _missing("infrared pair")
    images = (_of_infrared(image) for image in (frame.ir_left, frame.ir_right))
    for left, right in zip(*images, strict=True):
        yield (left + right) / 2


def _of_infrared(image: GreyImage) -> Iterator[Image]:
    level = image.astype(np.float32)
    mean = cv2.GaussianBlur(level, (0, 0), _NORMALISATION_PX)
    power = cv2.GaussianBlur(level**2, (0, 0), _NORMALISATION_PX) - mean**2
    contrast = np.sqrt(np.maximum(power, 0)) + _DARKEST_DN
    normal = np.asarray((level - mean) / contrast, np.float32)
    whole = np.ones(normal.shape, bool)
    yield from _shares(normal, whole, _INFRARED_EDGES)
    for response, valid in (*_differences(normal, whole), *_bands(normal, whole)):
        yield from _shares(response, valid, _INFRARED_EDGES)
        yield cell_means(np.where(valid, np.minimum(response**2, 9), 0))


KINDS: dict[str, Callable[[Frame, CaptureInfo], Iterator[Image]]] = {
    "depth": depth,
    "holes": holes,
    "infrared": infrared,
}


def statistics(kind: str, frame: Frame, info: CaptureInfo) -> Image:
    """Return the cell statistics of one kind, (c, h // 16, w // 16).

    Raises:
        InputError: if the frame lacks the images of this kind.
    """
    return np.stack(list(KINDS[kind](frame, info)))


def _disparity_px(frame: Frame, info: CaptureInfo) -> Image:
    if frame.depth_m is None:
        raise _missing("depth")
    return info.disparity_px(frame.depth_m)


def _missing(image: str) -> Exception:
    return refuse(image, "must be in every frame to be judged", "none", "Leave this kind out.")


def _shares(values: Image, valid: Mask, edges: Sequence[float]) -> Iterator[Image]:
    """Yield the share of a cell's pixels in each bin."""
    number = np.zeros(values.shape, np.uint8)
    for edge in edges:
        number += values >= np.float32(edge)
    yield from _counts(number * valid, len(edges))[1:]


def _counts(number: NDArray[np.uint8], count: int) -> Image:
    """Share of a cell's pixels that hold each number below a count, (count, rows, columns)."""
    rows, columns = (side // CELL_PX for side in number.shape)
    whole = number[: rows * CELL_PX, : columns * CELL_PX].astype(np.int32)
    cell = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns) * count
    place = whole.reshape(rows, CELL_PX, columns, CELL_PX) + cell[:, None, :, None]
    counts = np.bincount(place.ravel(), minlength=rows * columns * count)
    shares = counts.reshape(rows, columns, count) / CELL_PX**2
    return np.asarray(np.moveaxis(shares, -1, 0), np.float32)


def _differences(values: Image, known: Mask) -> Iterator[tuple[Image, Mask]]:
    """Yield first and second differences along rows and columns, and where they are known."""
    for axis in (0, 1):
        for step in _STEPS_PX:
            after, before = np.roll(values, -step, axis), np.roll(values, step, axis)
            known_after, known_before = np.roll(known, -step, axis), np.roll(known, step, axis)
            inside = np.ones(known.shape, bool)
            np.moveaxis(inside, axis, 0)[-step:] = False
            yield after - values, known & known_after & inside
            np.moveaxis(inside, axis, 0)[:step] = False
            yield after + before - 2 * values, known & known_after & known_before & inside


def _bands(values: Image, known: Mask) -> Iterator[tuple[Image, Mask]]:
    """Yield values less their local mean over known pixels, at several scales."""
    weight = known.astype(np.float32)
    for sigma in _SMOOTHINGS_PX:
        mean = cv2.GaussianBlur(values * weight, (0, 0), sigma)
        mean /= np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-6)
        yield values - mean, known


def _of_holes(hole: Mask) -> Iterator[Image]:
    yield cell_means(hole)
    yield from _patterns(hole)
    for mask in (hole, ~hole):
        for along in (mask, mask.T):
            lengths = _run_lengths(along)
            yield from _shares(lengths if along is mask else lengths.T, mask, _RUN_EDGES_PX)
        yield from _shares(_areas(mask), mask, _AREA_EDGES_PX)


def _patterns(hole: Mask) -> Iterator[Image]:
    """Yield shares of the 2 x 2 patterns of a mask, at several steps, without the uniform ones."""
    for step in _STEPS_PX:
        down = np.roll(hole, -step, 0)
        corners = (hole, np.roll(hole, -step, 1), down, np.roll(down, -step, 1))
        code = np.zeros(hole.shape, np.uint8)
        for bit, corner in enumerate(corners):
            code |= corner.astype(np.uint8) << bit
        code[-step:], code[:, -step:] = 0, 0
        yield from _counts(code, _PATTERNS)[1:-1]


def _run_lengths(mask: Mask) -> Image:
    """Length of the run along its row that each pixel of a mask belongs to, 0 outside [px]."""
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    rows, starts = np.nonzero(change == 1)
    ends = np.nonzero(change == -1)[1]
    lengths = np.zeros((mask.shape[0], mask.shape[1] + 1), np.float32)
    np.add.at(lengths, (rows, starts), ends - starts)
    np.add.at(lengths, (rows, ends), starts - ends)
    return np.cumsum(lengths, axis=1)[:, :-1].astype(np.float32)


def _areas(mask: Mask) -> Image:
    """Area of the connected part that each pixel of a mask belongs to [px]."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    areas = np.asarray(stats[:, cv2.CC_STAT_AREA], np.float32)
    return np.take(areas, np.asarray(labels, np.intp))
