"""Fixed-pattern noise with non-Gaussian laws, as real chips have non-Gaussian tails."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws

Image = NDArray[np.float64]


def sensitivity(shape: tuple[int, int], share: float, rng: np.random.Generator) -> Image:
    """Draw the gain of each pixel (h, w): gamma variates of mean 1 and std `share`."""
    return rng.gamma(share**-2, share**2, shape)


def offsets(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Draw the offset of each pixel (h, w) [electrons]: logistic variates with heavy tails."""
    return rng.logistic(0.0, deviation_e * math.sqrt(3.0) / math.pi, shape)


def columns(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Draw the offset of each column (1, w) [electrons]: uniform, as of trimmed amplifiers."""
    reach = deviation_e * math.sqrt(3.0)
    return rng.uniform(-reach, reach, (1, shape[1]))


def saturated_pixels(
    shape: tuple[int, int], share: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Draw a mask (h, w) of saturated pixels: a Poisson number of positions with replacement."""
    pixels = rng.integers(0, shape[0] * shape[1], rng.poisson(share * shape[0] * shape[1]))
    hot = np.zeros(shape[0] * shape[1], bool)
    hot[pixels] = True
    return hot.reshape(shape)


def add_offsets(charge_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add pixel and column offsets to a charge (h, w) [electrons]."""
    for name, draw in (("dsnu", offsets), ("column_noise", columns)):
        deviation_e = strengths.value(name)
        if deviation_e != 0.0:
            rng = draws.device_rng(f"{side}/{name}")
            charge_e = charge_e + draw(charge_e.shape, deviation_e, rng)
    return charge_e
