"""A training frame: with the camera's holes, or with random ones; and places of its crops."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.method import Image
from starling.patterns.errors import InputError, refuse
from starling.sim.randomness import generator

Holes = Literal["camera", "random"]

_SIDES = (0.02, 0.25)  # Range of the sides of rectangular random holes, relative to the image's.
_SINGLE = 0.5  # Share of randomly removed pixels that are single pixels.


def none_has_depth(count: int) -> InputError:
    """Build the error of frames that all have no depth."""
    advice = "Give other frames."
    return refuse("frames", "must have depth", f"none in all {count}", advice)


def training_frame(pair: Pair, holes: Holes, *, seed: int, number: int) -> Pair | None:
    """Prepare a frame for training; None if it has no depth.

    Args:
        pair: the frame.
        holes: the camera's own, or random ones as a control.
        seed: seed of random holes.
        number: number of the frame, so that frames differ.

    Raises:
        InputError: if random holes are requested and the truth is unknown.
    """
    if holes == "random":
        depth_m = with_random_holes(pair.depth_m, pair.truth(), seed=seed, number=number)
        pair = dataclasses.replace(pair, depth_m=depth_m)
    return pair if pair.valid.any() else None


def with_random_holes(depth_m: Image, truth_m: Image, *, seed: int, number: int) -> Image:
    """Replace holes by random ones that depend on neither light nor geometry.

    This is the usual training data of completion, and the control that measures the value of
    simulated holes. The camera's noise stays where it has depth. Its holes are filled with the
    noise-free truth, and an equal share of pixels is removed at random. Half of it is removed as
    rectangles and half as single pixels.

    Args:
        depth_m: (h, w) the camera's own depth [m], NaN where missing.
        truth_m: (h, w) [m]; holes with unknown truth remain.
        seed: random seed.
        number: number of the frame, so that frames differ.
    """
    rng = generator(seed, number, "completion", "random holes")
    share = float(np.isnan(depth_m).mean())
    closed = np.where(np.isnan(depth_m), truth_m, depth_m)
    height, width = closed.shape
    out = rng.random(closed.shape) < _SINGLE * share
    wanted = share * closed.size
    while (missing := int(wanted) - np.count_nonzero(out)) > 0:
        rows = int(height * rng.uniform(*_SIDES)) + 1
        columns = int(width * rng.uniform(*_SIDES)) + 1
        top = int(rng.integers(height - rows + 1))
        left = int(rng.integers(width - columns + 1))
        block = np.zeros_like(out)
        block[top : top + rows, left : left + columns] = True
        out.flat[np.flatnonzero(block & ~out)[:missing]] = True  # The last block is cut to size.
    return np.where(out, np.float32(np.nan), closed).astype(np.float32)


def window_start(middle: int, part: int, whole: int) -> int:
    """Return the start of a crop along one side, with a given pixel at or near its centre.

    Args:
        middle: the pixel.
        part: length of the crop; a crop longer than the side starts at 0.
        whole: length of the frame's side.
    """
    return max(min(middle - part // 2, whole - part), 0)
