"""What a chip's pixels differ in by birth, none of it normal: real chips' tails are not either."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws

Image = NDArray[np.float64]


def sensitivity(shape: tuple[int, int], share: float, rng: np.random.Generator) -> Image:
    """Factor of each pixel (h, w): gamma variates of mean 1 and deviation `share`."""
    return rng.gamma(share**-2, share**2, shape)


def offsets(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Offset of each pixel (h, w) [electrons]: logistic variates, of heavier tails than normal."""
    return rng.logistic(0.0, deviation_e * math.sqrt(3.0) / math.pi, shape)


def columns(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Offset of each column (1, w) [electrons]: even over an interval, as trimmed amplifiers."""
    reach = deviation_e * math.sqrt(3.0)
    return rng.uniform(-reach, reach, (1, shape[1]))


def full(shape: tuple[int, int], share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Pixels (h, w) that are always full: a Poisson number of places, some drawn twice."""
    places = rng.integers(0, shape[0] * shape[1], rng.poisson(share * shape[0] * shape[1]))
    hot = np.zeros(shape[0] * shape[1], bool)
    hot[places] = True
    return hot.reshape(shape)


def add_offsets(charge_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add the offsets of pixels and columns to a charge (h, w) [electrons]."""
    for name, draw in (("dsnu", offsets), ("column_noise", columns)):
        deviation_e = strengths.of(name)
        if deviation_e != 0.0:
            rng = draws.of_device(f"{side}/{name}")
            charge_e = charge_e + draw(charge_e.shape, deviation_e, rng)
    return charge_e
