"""Perlin's gradient noise with a uniform marginal, static or slowly changing from frame to frame.

Noise: K. Perlin, An Image Synthesizer, SIGGRAPH 1985, with the fade of fifth degree of Improving
Noise, SIGGRAPH 2002. Time: K. Perlin and F. Neyret, Flow Noise, SIGGRAPH 2001 sketches: each
gradient rotates at its own speed, so that the statistics of all frames are equal. Slices of noise
in three dimensions would change with their distance from the planes of the lattice.

Gradient noise is zero on its lattice. Two lattices half a cell apart fill each other's zeros. The
remaining variation of the variance is known in closed form and divided out.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse, special

from starling.patterns import errors
from starling.patterns.errors import whole_number
from starling.sim.randomness import generator

_HALF_CELL = (0.0, 0.5)  # Offsets of the two lattices.
_LARGEST_T, _STEPS_T = 40.0, 800  # The characteristic function is below 1e-4 from t = 20 on.


@dataclass(frozen=True, kw_only=True, slots=True)
class Perlin:
    """Gradient noise, isotropic in the image.

    Args:
        correlation_px: Shift at which the noise's autocorrelation is one half [px].
        correlation_frames: Standard deviation of the autocorrelation in time, which is
            exp(-(t / correlation_frames)^2 / 2) [frames].

    Raises:
        InputError: if a correlation is not above zero.
    """

    correlation_px: float
    correlation_frames: float

    def __post_init__(self) -> None:
        errors.positive("correlation_px", self.correlation_px, "Give a length [px].")
        errors.positive("correlation_frames", self.correlation_frames, "Give a time [frames].")

    @property
    def cell_px(self) -> float:
        """Spacing of the lattice [px]."""
        return self.correlation_px / _half_correlation_cells()


def uniform(
    shape: tuple[int, int], noise: Perlin, *, seed: int, frame: float = 0.0
) -> NDArray[np.float32]:
    """Return one frame of noise with a uniform marginal distribution.

    Args:
        shape: (h, w) of the image; the noise does not repeat in it.
        noise: correlations in space and time.
        seed: seed of the noise of all frames of a sequence.
        frame: time; frames are correlated by `noise.correlation_frames`.

    Returns:
        (h, w) in [0, 1): the share of pixels below p is p, at every place in the image.

    Raises:
        InputError: if a side is not 1 to 16384 pixels.
    """
    value = standard(shape, noise, seed=seed, frame=frame)
    levels, below = _distribution()
    largest = np.nextafter(np.float32(1), np.float32(0))
    return np.minimum(np.interp(value, levels, below).astype(np.float32), largest)


def standard(
    shape: tuple[int, int], noise: Perlin, *, seed: int, frame: float = 0.0
) -> NDArray[np.float64]:
    """Return one frame of noise with mean 0 and variance 1 (h, w); arguments as for `uniform`."""
    height = whole_number("height", shape[0], 1, 16384, "Give the image's shape (h, w).")
    width = whole_number("width", shape[1], 1, 16384, "Give the image's shape (h, w).")
    draw = generator(seed, 0, "learning", "perlin")
    start_y, start_x = draw.random(2)
    value, variance = np.zeros((height, width)), np.zeros((height, width))
    for shift in _HALF_CELL:
        down = _Ramp.along(height, noise.cell_px, start_y + shift)
        across = _Ramp.along(width, noise.cell_px, start_x + shift)
        nodes = down.nodes, across.nodes
        speed = draw.standard_normal(nodes) / noise.correlation_frames
        angle = 2 * math.pi * draw.random(nodes) + speed * frame
        value += down.weight @ (across.moment @ np.cos(angle).T).T
        value += down.moment @ (across.weight @ np.sin(angle).T).T
        variance += 0.5 * np.outer(down.weight_squared, across.moment_squared)
        variance += 0.5 * np.outer(down.moment_squared, across.weight_squared)
    return value / np.sqrt(variance)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Ramp:
    """Contributions of the lattice's nodes along one axis of `n` pixels.

    The noise is separable: sum over nodes of g_x m(x) w(y) + g_y w(x) m(y) for gradients g. Here w
    is the fade of a node's influence and m(x) = x w(x).
    """

    nodes: int
    weight: sparse.csr_array  # (n, nodes)
    moment: sparse.csr_array
    weight_squared: NDArray[np.float64]  # (n,) sum over nodes.
    moment_squared: NDArray[np.float64]

    @classmethod
    def along(cls, n: int, cell_px: float, start: float) -> _Ramp:
        place = np.arange(n) / cell_px + start
        below = np.floor(place).astype(np.int64)
        nodes = int(below[-1]) + 2
        rows = np.repeat(np.arange(n), 2)
        columns = np.stack([below, below + 1], axis=1).ravel()
        offset = np.repeat(place, 2) - columns
        fade = _fade(offset)

        def matrix(value: NDArray[np.float64]) -> sparse.csr_array:
            return sparse.csr_array((value, (rows, columns)), shape=(n, nodes))

        return cls(
            nodes=nodes,
            weight=matrix(fade),
            moment=matrix(offset * fade),
            weight_squared=(fade**2).reshape(n, 2).sum(axis=1),
            moment_squared=((offset * fade) ** 2).reshape(n, 2).sum(axis=1),
        )


def _fade(offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Influence of a node at some distance in cells: 1 - (6 t^5 - 15 t^4 + 10 t^3)."""
    t = np.minimum(np.abs(offset), 1)
    return 1 - t**3 * (t * (6 * t - 15) + 10)


@functools.cache
def _half_correlation_cells() -> float:
    """Shift along an axis, in cells, at which the autocorrelation is one half.

    This is the mean covariance of the noise over its mean variance. The effect of dividing by the
    local standard deviation is below the tolerance of the test.
    """
    x = np.linspace(-1, 1, 2001)
    w, m = _fade(x), x * _fade(x)
    step = x[1] - x[0]

    def overlap(f: NDArray[np.float64], shift: float) -> float:
        return float((f * np.interp(x + shift, x, f, left=0, right=0)).sum() * step)

    def correlation(shift: float) -> float:
        covariance = overlap(m, shift) * overlap(w, 0) + overlap(w, shift) * overlap(m, 0)
        return covariance / (2 * overlap(m, 0) * overlap(w, 0))

    solution = optimize.root_scalar(lambda shift: correlation(shift) - 0.5, bracket=(0, 1))
    return float(solution.root)


@functools.cache
def _distribution() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return values of the noise and the probability to be below each.

    A node contributes a cos(angle), whose characteristic function is the Bessel function J0(a t).
    That of a sum is the product. It is averaged over the places in a cell and inverted by
    Gil-Pelaez (Biometrika 38, 1951).
    """
    t = np.asarray((np.arange(_STEPS_T) + 0.5) * (_LARGEST_T / _STEPS_T), np.float64)
    transform = _characteristic(t)
    levels = np.linspace(-6, 6, 2401)
    below = 0.5 + np.sin(np.outer(levels, t)) @ (transform / t) * (_LARGEST_T / _STEPS_T) / math.pi
    return levels, np.maximum.accumulate(np.clip(below, 0, 1))


def _characteristic(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Characteristic function of noise of unit variance, averaged over a cell."""
    place = (np.arange(8) + 0.5) / 16  # By symmetry, an eighth of a cell is sufficient.
    y, x = (value.ravel() for value in np.meshgrid(place, place))
    amplitudes = []
    for shift in _HALF_CELL:
        for j in (0, 1):
            for i in (0, 1):
                dx, dy = (x + shift) % 1 - i, (y + shift) % 1 - j
                amplitudes.append(np.hypot(dx, dy) * _fade(dx) * _fade(dy))
    amplitude = np.array(amplitudes)
    amplitude /= np.sqrt(0.5 * (amplitude**2).sum(axis=0))
    mean = np.zeros_like(t)
    for column in amplitude.T:
        mean += special.j0(np.outer(column, t)).prod(axis=0)
    return mean / amplitude.shape[1]
