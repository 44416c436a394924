"""Find dot lattices in a recovered pattern by its spectrum.

A diffractive element or a microlens array projects dots on a regular lattice in direction cosines.
Its spectrum is a lattice of sharp peaks, the reciprocal lattice. Each emitter has its own lattice.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern.unprojected import PatternImage

_SIZE = 2048  # Size of the spectrum [bins].
_TIMES_FLOOR = 10.0  # Minimum height of a peak over the median of its ring; noise reaches 5.
_PEAK_BINS = 9  # Side of the window of a local maximum [bins].
_MOST_PEAKS = 80
_MOST_LATTICES = 4
_TOLERANCE_BINS = 3.0  # Position tolerance of a peak.
# Minimum height over the first lattice's. Peaks of products of two lattices are lower.
_LEAST_OF_FIRST = 0.3
_LEAST_SINE = 0.5  # Minimum sine of the angle of two basis vectors (30 degrees).
_INVERTED = 6  # Iterations that invert the keystone; each reduces the error by a factor of |k|.
_FIRST_SIGMA = 1.75e-3  # Initial width of a dot, in cosines.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lattice:
    """Dots at all cosines a at which F a (1 - k . a) - phase is an integer.

    The keystone k widens the lattice towards one side: its scale at a is 1 + k . a.
    """

    frequencies: NDArray[np.float64]  # (2, 2) rows of F [cycles per unit cosine].
    phase: NDArray[np.float64]  # (2,)
    keystone: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))  # (2,) k.
    sigma: float = _FIRST_SIGMA  # Standard deviation of a dot, in cosines.

    @property
    def pitch(self) -> NDArray[np.floating[Any]]:
        """Basis vectors of the dots as columns (2, 2), in cosines."""
        return np.linalg.inv(self.frequencies)

    def nearest(self, cosines: NDArray) -> tuple[NDArray, NDArray]:
        """Return the index (n, 2) of the dot nearest to each direction, and the offset (n, 2).

        The offset is that in a lattice without keystone.
        """
        frequencies, pitch = (m.T.astype(cosines.dtype) for m in (self.frequencies, self.pitch))
        even = cosines * (1 - cosines @ self.keystone.astype(cosines.dtype))[:, None]
        steps = even @ frequencies - self.phase.astype(cosines.dtype)
        number = np.rint(steps)
        return number, (steps - number) @ pitch

    def dots(self, half_a: float, half_b: float) -> NDArray[np.float64]:
        """Return the cosines (n, 2) of all dots with |a| <= half_a and |b| <= half_b."""
        corners = np.array([[i * half_a, j * half_b] for i in (-1, 1) for j in (-1, 1)])
        steps = corners @ self.frequencies.T - self.phase
        low, high = np.floor(steps.min(0)).astype(int), np.ceil(steps.max(0)).astype(int)
        i, j = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)))
        even = (np.stack([i.ravel(), j.ravel()], axis=1) + self.phase) @ self.pitch.T
        cosines = even
        for _ in range(_INVERTED):
            cosines = even / (1 - cosines @ self.keystone)[:, None]
        return cosines[(np.abs(cosines) <= [half_a, half_b]).all(axis=1)]


def find(pattern: PatternImage) -> tuple[Lattice, ...]:
    """Find the lattices of a pattern, strongest first; none if its dots are irregular.

    A lattice requires peaks at both basis frequencies, at their sum and at their difference.
    """
    windowed, a_cosines, b_cosines = _windowed(pattern)
    spectrum = np.abs(np.fft.fftshift(np.fft.fft2(windowed, s=(_SIZE, _SIZE)))).astype(np.float32)
    ratio = np.asarray(spectrum / _floor(spectrum), np.float32)
    peaks = _peaks(ratio)
    lattices: list[Lattice] = []
    least = _TIMES_FLOOR
    while len(lattices) < _MOST_LATTICES:
        basis, strength = _basis(peaks, ratio, least)
        if basis is None:
            break
        least = max(least, _LEAST_OF_FIRST * strength)
        bin_width = 1 / (_SIZE * pattern.grid.step)
        lattices.append(_refine(basis * bin_width, windowed, a_cosines, b_cosines))
        peaks = _without(peaks, basis)
    return tuple(lattices)


def _windowed(pattern: PatternImage) -> tuple[NDArray, NDArray, NDArray]:
    height, width = pattern.grid.shape
    known = np.isfinite(pattern.sd)
    window = np.hanning(height)[:, None] * np.hanning(width)[None, :]
    # Clip scene texture, which is stronger than dots but rare.
    value = np.clip(np.where(known, pattern.value, 0), -3, 3) * window
    return value, *pattern.grid.cosines()


def _floor(spectrum: NDArray[np.float32]) -> NDArray[np.floating[Any]]:
    """Return the median of the spectrum at each radius, as an image."""
    middle = _SIZE // 2
    y, x = np.ogrid[-middle : _SIZE - middle, -middle : _SIZE - middle]
    ring = np.minimum(np.hypot(x, y), middle - 1).astype(np.intp) // 8
    order = np.argsort(ring, axis=None, kind="stable")
    ends = np.cumsum(np.bincount(ring.ravel()))
    values = spectrum.ravel()[order]
    medians = [np.median(part) for part in np.split(values, ends[:-1])]
    return np.maximum(np.asarray(medians, np.float32), 1e-20)[ring]


def _peaks(ratio: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return frequencies (n, 2) of the peaks [bins], strongest first; one of each +- pair."""
    highest = cv2.dilate(ratio, np.ones((_PEAK_BINS, _PEAK_BINS), np.uint8))
    y, x = np.nonzero((ratio == highest) & (ratio > _TIMES_FLOOR))
    order = np.argsort(-ratio[y, x], kind="stable")
    points = np.stack([x[order], y[order]], axis=1).astype(np.float64) - _SIZE / 2
    upper = (points[:, 0] > 0) | ((points[:, 0] == 0) & (points[:, 1] > 0))
    return points[upper][:_MOST_PEAKS]


def _basis(
    peaks: NDArray[np.float64], ratio: NDArray[np.float32], least: float
) -> tuple[NDArray[np.float64] | None, float]:
    """Return two short frequencies (2, 2) with peaks at their sum and difference, and the support.

    Multiples of a basis have such peaks as well, so the score prefers short frequencies.
    """
    best, chosen, strength = 0.0, None, 0.0
    for i, first in enumerate(peaks):
        for second in peaks[:i]:
            lengths = float(np.linalg.norm(first)), float(np.linalg.norm(second))
            sine = abs(first[0] * second[1] - first[1] * second[0]) / (lengths[0] * lengths[1])
            if sine < _LEAST_SINE or not 0.5 < lengths[0] / lengths[1] < 2:
                continue
            combinations = (first, second, first + second, first - second)
            support = min(_height(ratio, point) for point in combinations)
            if support > least and support / (lengths[0] * lengths[1]) > best:
                best, strength = support / (lengths[0] * lengths[1]), support
                chosen = np.stack([first, second])
    return chosen, strength


def _height(ratio: NDArray[np.float32], point: NDArray[np.float64]) -> float:
    x, y = np.rint(point + _SIZE / 2).astype(int)
    reach = int(_TOLERANCE_BINS)
    if not (reach <= x < _SIZE - reach and reach <= y < _SIZE - reach):
        return 0.0
    return float(ratio[y - reach : y + reach + 1, x - reach : x + reach + 1].max())


def _without(peaks: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the peaks that are not integer combinations of the basis."""
    steps = peaks @ np.linalg.inv(basis)
    distance = np.linalg.norm((steps - np.rint(steps)) @ basis, axis=1)
    return peaks[distance > 2 * _TOLERANCE_BINS]


def _refine(frequencies: NDArray[np.float64], windowed: NDArray, a: NDArray, b: NDArray) -> Lattice:
    """Move each frequency to the maximum of its peak, and compute the phase there."""
    phase = np.zeros(2)
    step = 1 / (_SIZE * (a[1] - a[0]))
    for row in range(2):
        for width in (0.5 * step, 0.2 * step, 0.1 * step):
            across, down = frequencies[row, :, None] + width * np.arange(-2, 3)
            heights = np.abs(_amplitudes(windowed, a, b, across, down))
            j, i = np.unravel_index(np.argmax(heights), heights.shape)
            frequencies[row] = across[i], down[j]
        ((amplitude,),) = _amplitudes(windowed, a, b, frequencies[row, :1], frequencies[row, 1:])
        phase[row] = -np.angle(amplitude) / (2 * np.pi)
    return Lattice(frequencies=frequencies, phase=phase)


def _amplitudes(
    windowed: NDArray, a: NDArray, b: NDArray, across: NDArray, down: NDArray
) -> NDArray[np.complex128]:
    """Return Fourier sums (n, m) at frequencies `across` (m,) and `down` (n,)."""
    wave = 2 * np.pi * np.outer(a, across)
    rows = windowed @ np.cos(wave) - 1j * (windowed @ np.sin(wave))
    return np.exp(-2j * np.pi * np.outer(down, b)) @ rows
