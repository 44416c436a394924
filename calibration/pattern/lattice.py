"""Dot lattices: found in a recovered pattern by their spectrum.

A diffractive element or a microlens array lays dots on a regular lattice in direction cosines. Its
spectrum is a lattice of sharp peaks, the reciprocal one; emitters side by side give one each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern.unprojected import PatternImage

_SIZE = 2048  # Of the spectrum [bins].
_TIMES_FLOOR = 10.0  # A peak is this much above the median of its ring; noise reaches 5.
_PEAK_BINS = 9  # Peaks are at least half this far apart.
_MOST_PEAKS = 80
_MOST_LATTICES = 4
_TOLERANCE_BINS = 3.0
_LEAST_OF_FIRST = 0.3  # A lattice's peaks over the first one's: products of two lattices are less.
_LEAST_SINE = 0.5  # Two basis vectors enclose at least 30 degrees.
_INVERTED = 6  # Rounds that invert the keystone: each is exact by a further factor of |k|.
_FIRST_SIGMA = 1.75e-3  # Of a dot, in cosines, before any fit.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lattice:
    """Dots at all cosines a where F a (1 - k . a) - phase is whole.

    The keystone k lets the lattice widen towards one side: its scale at a is 1 + k . a.
    """

    frequencies: NDArray[np.float64]  # (2, 2), F by rows: cycles over a unit of cosine.
    phase: NDArray[np.float64]  # (2,)
    keystone: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))  # (2,) k.
    sigma: float = _FIRST_SIGMA  # Deviation of a dot's light on each axis, in cosines.

    @property
    def pitch(self) -> NDArray[np.floating[Any]]:
        """Basis vectors of the dots by columns (2, 2), in cosines."""
        return np.linalg.inv(self.frequencies)

    def nearest(self, cosines: NDArray) -> tuple[NDArray, NDArray]:
        """Number (n, 2) of the dot nearest to each direction, and the way from it (n, 2).

        The way is that of an even lattice, before the keystone.
        """
        frequencies, pitch = (m.T.astype(cosines.dtype) for m in (self.frequencies, self.pitch))
        even = cosines * (1 - cosines @ self.keystone.astype(cosines.dtype))[:, None]
        steps = even @ frequencies - self.phase.astype(cosines.dtype)
        number = np.rint(steps)
        return number, (steps - number) @ pitch

    def dots(self, half_a: float, half_b: float) -> NDArray[np.float64]:
        """Cosines (n, 2) of all dots with |a| <= half_a and |b| <= half_b."""
        corners = np.array([[i * half_a, j * half_b] for i in (-1, 1) for j in (-1, 1)])
        steps = corners @ self.frequencies.T - self.phase
        low, high = np.floor(steps.min(0)).astype(int), np.ceil(steps.max(0)).astype(int)
        i, j = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)))
        even = (np.stack([i.ravel(), j.ravel()], axis=1) + self.phase) @ self.pitch.T
        found = even
        for _ in range(_INVERTED):
            found = even / (1 - found @ self.keystone)[:, None]
        return found[(np.abs(found) <= [half_a, half_b]).all(axis=1)]


def find(pattern: PatternImage) -> tuple[Lattice, ...]:
    """Find the lattices of a pattern, the strongest first; none where its dots are scattered.

    A lattice counts where both basis frequencies and their sum and difference stand out of the
    spectrum.
    """
    windowed, a, b = _windowed(pattern)
    spectrum = np.abs(np.fft.fftshift(np.fft.fft2(windowed, s=(_SIZE, _SIZE)))).astype(np.float32)
    ratio = np.asarray(spectrum / _floor(spectrum), np.float32)
    peaks = _peaks(ratio)
    found: list[Lattice] = []
    least = _TIMES_FLOOR
    while len(found) < _MOST_LATTICES:
        basis, strength = _basis(peaks, ratio, least)
        if basis is None:
            break
        least = max(least, _LEAST_OF_FIRST * strength)
        bin_width = 1 / (_SIZE * pattern.grid.step)
        found.append(_refined(basis * bin_width, windowed, a, b))
        peaks = _without(peaks, basis)
    return tuple(found)


def _windowed(pattern: PatternImage) -> tuple[NDArray, NDArray, NDArray]:
    height, width = pattern.grid.shape
    known = np.isfinite(pattern.sd)
    window = np.hanning(height)[:, None] * np.hanning(width)[None, :]
    # Scenes' own texture is stronger than any dot, but rare.
    value = np.clip(np.where(known, pattern.value, 0), -3, 3) * window
    return value, *pattern.grid.cosines()


def _floor(spectrum: NDArray[np.float32]) -> NDArray[np.floating[Any]]:
    """Median of the spectrum at each distance from its middle, as an image."""
    middle = _SIZE // 2
    y, x = np.ogrid[-middle : _SIZE - middle, -middle : _SIZE - middle]
    ring = np.minimum(np.hypot(x, y), middle - 1).astype(np.intp) // 8
    order = np.argsort(ring, axis=None, kind="stable")
    ends = np.cumsum(np.bincount(ring.ravel()))
    values = spectrum.ravel()[order]
    medians = [np.median(part) for part in np.split(values, ends[:-1])]
    return np.maximum(np.asarray(medians, np.float32), 1e-20)[ring]


def _peaks(ratio: NDArray[np.float32]) -> NDArray[np.float64]:
    """Frequencies (n, 2) of the peaks [bins], x and y, strongest first; one of each +- pair."""
    highest = cv2.dilate(ratio, np.ones((_PEAK_BINS, _PEAK_BINS), np.uint8))
    y, x = np.nonzero((ratio == highest) & (ratio > _TIMES_FLOOR))
    order = np.argsort(-ratio[y, x], kind="stable")
    points = np.stack([x[order], y[order]], axis=1).astype(np.float64) - _SIZE / 2
    upper = (points[:, 0] > 0) | ((points[:, 0] == 0) & (points[:, 1] > 0))
    return points[upper][:_MOST_PEAKS]


def _basis(
    peaks: NDArray[np.float64], ratio: NDArray[np.float32], least: float
) -> tuple[NDArray[np.float64] | None, float]:
    """The two shortest frequencies (2, 2) whose sum and difference are peaks too, and how strong.

    Multiples of a basis have their sums and differences as well, so short ones come first.
    """
    best, chosen, strength = 0.0, None, 0.0
    for i, first in enumerate(peaks):
        for second in peaks[:i]:
            lengths = float(np.linalg.norm(first)), float(np.linalg.norm(second))
            sine = abs(first[0] * second[1] - first[1] * second[0]) / (lengths[0] * lengths[1])
            if sine < _LEAST_SINE or not 0.5 < lengths[0] / lengths[1] < 2:
                continue
            both = (first, second, first + second, first - second)
            support = min(_height(ratio, point) for point in both)
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
    """The peaks that are no whole combination of the basis."""
    steps = peaks @ np.linalg.inv(basis)
    off = np.linalg.norm((steps - np.rint(steps)) @ basis, axis=1)
    return peaks[off > 2 * _TOLERANCE_BINS]


def _refined(
    frequencies: NDArray[np.float64], windowed: NDArray, a: NDArray, b: NDArray
) -> Lattice:
    """Move each frequency to its spectrum's top, and read the phase there."""
    phase = np.zeros(2)
    step = 1 / (_SIZE * (a[1] - a[0]))
    for row in range(2):
        for width in (0.5 * step, 0.2 * step, 0.1 * step):
            across, down = frequencies[row, :, None] + width * np.arange(-2, 3)
            heights = np.abs(_amplitudes(windowed, a, b, across, down))
            j, i = np.unravel_index(np.argmax(heights), heights.shape)
            frequencies[row] = across[i], down[j]
        ((top,),) = _amplitudes(windowed, a, b, frequencies[row, :1], frequencies[row, 1:])
        phase[row] = -np.angle(top) / (2 * np.pi)
    return Lattice(frequencies=frequencies, phase=phase)


def _amplitudes(
    windowed: NDArray, a: NDArray, b: NDArray, across: NDArray, down: NDArray
) -> NDArray[np.complex128]:
    """Fourier sums (n, m) at frequencies `across` (m,) by `down` (n,)."""
    wave = 2 * np.pi * np.outer(a, across)
    rows = windowed @ np.cos(wave) - 1j * (windowed @ np.sin(wave))
    return np.exp(-2j * np.pi * np.outer(down, b)) @ rows
