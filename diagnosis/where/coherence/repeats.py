"""What two rooms have in common at one place of the camera image, or of the projector's field.

A pattern that is fixed in one frame moves in the other, by as much as the rooms differ in depth. If
they hardly differ, both frames see both patterns. This overlap follows from the geometry and is
solved for, so each pattern counts in its own frame alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence.spectra import (
    COLUMN_FREQUENCY,
    ROW_FREQUENCY,
    Plane,
    Spectra,
    band_sums,
    cross,
)

Shares = NDArray[np.float64]  # (bands,)

_FEWEST = 4  # Least number of common windows of a pair of rooms.
_SEPARABLE = 0.5  # Least determinant: separation doubles errors at most.
_LEAST_DETERMINANT = 0.1  # Keeps a resample finite.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FrameSpectra:
    """Unexplained part of one scene in the windows of one frame."""

    cells: NDArray[np.intp]  # Sorted grid cells.
    left: Spectra
    right: Spectra
    # (windows, 2) mean and standard deviation of the place in the other frame [px].
    place: NDArray[np.float64]
    spread: NDArray[np.float64]
    power: NDArray[np.float64]  # (windows, bands) unexplained mean square of both imagers.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneSpectra:
    """Unexplained part of one scene in both frames."""

    camera: FrameSpectra
    projector: FrameSpectra


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PairRepeats:
    """Correlation of two rooms' unexplained parts in one frame, by band."""

    windows: int
    common: Shares  # Of a left with a right image: lies on surfaces.
    single: Shares  # Of left with left images: contains each imager's pattern too.
    overlap: Shares  # Share of a pattern of the other frame that this frame sees.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Patterns:
    """Shares of the unexplained power by band; NaN without common windows of two rooms."""

    projector: Shares  # Repeats in the projector's field.
    camera: Shares  # Repeats in the camera image, and is common to both imagers.
    imager: Shares  # Repeats in the camera image, and belongs to one imager.
    determinant: Shares  # 1 if neither frame sees the other's pattern, 0 if both are equal.

    @property
    def separable(self) -> NDArray[np.bool_]:
        """Whether rooms differ enough in depth to separate the frames (bands,)."""
        return self.determinant >= _SEPARABLE


def frame_repeats(first: FrameSpectra, second: FrameSpectra) -> PairRepeats:
    """Correlate two scenes of different rooms in the windows that both know."""
    _, in_first, in_second = np.intersect1d(first.cells, second.cells, True, return_indices=True)
    count = len(in_first)
    if count < _FEWEST:
        unknown = np.zeros(first.power.shape[1])
        return PairRepeats(windows=0, common=unknown, single=unknown, overlap=unknown)
    left, right = first.left[in_first], first.right[in_first]
    across = 0.5 * (cross(left, second.right[in_second]) + cross(right, second.left[in_second]))
    single = cross(left, second.left[in_second])
    size = np.abs(left) * np.abs(second.left[in_second])
    scale = _geometric_power(first.power[in_first], second.power[in_second])
    apart = first.place[in_first] - second.place[in_second]
    varying = first.spread[in_first] ** 2 + second.spread[in_second] ** 2
    seen = _displaced(size, apart, varying)
    return PairRepeats(
        windows=count,
        common=_ratio(band_sums(across), scale),
        single=_ratio(band_sums(single), scale),
        overlap=_ratio(band_sums(seen), band_sums(size.sum(axis=0))),
    )


def separate(
    camera: Sequence[PairRepeats], projector: Sequence[PairRepeats], times: NDArray[np.float64]
) -> Patterns:
    """Solve for the patterns of both frames.

    Args:
        camera: of pairs of rooms, in the camera image.
        projector: of the same pairs, in the projector's field.
        times: (pairs,) weight of each pair.
    """
    image, single, seen_in_image = _means(camera, times)
    field, _, seen_in_field = _means(projector, times)
    determinant = 1 - seen_in_image * seen_in_field
    divisor = np.maximum(determinant, _LEAST_DETERMINANT)
    return Patterns(
        projector=(field - seen_in_field * image) / divisor,
        camera=(image - seen_in_image * field) / divisor,
        imager=single - image,
        determinant=determinant,
    )


def _means(
    pairs: Sequence[PairRepeats], times: NDArray[np.float64]
) -> tuple[Shares, Shares, Shares]:
    """Average over pairs, weighted by their windows; NaN without any."""
    weight = times * [pair.windows for pair in pairs]
    total = weight.sum()
    values = [
        np.stack([getattr(pair, name) for pair in pairs])
        for name in ("common", "single", "overlap")
    ]
    common, single, overlap = (
        weight @ each / total if total > 0 else np.full(each.shape[1], np.nan) for each in values
    )
    return common, single, overlap


def _displaced(
    size: NDArray[np.float32], apart: NDArray[np.float64], varying: NDArray[np.float64]
) -> Plane:
    """Sum the correlation of a pattern with itself at other places (rows, columns).

    Args:
        size: (windows, rows, columns) product of both amplitudes.
        apart: (windows, 2) distance right and down [px].
        varying: (windows, 2) variance of the distance within a window.
    """
    total = np.zeros(size.shape[1:])
    for amplitude, (right, down), (var_x, var_y) in zip(size, apart, varying, strict=True):
        columns = _phase(COLUMN_FREQUENCY.ravel(), right, var_x)
        rows = _phase(ROW_FREQUENCY.ravel(), down, var_y)
        total += amplitude * np.real(rows[:, None] * columns[None])
    return total


def _phase(
    frequency: NDArray[np.float64], distance: float, variance: float
) -> NDArray[np.complex128]:
    angle = 2 * np.pi * frequency
    return np.exp(1j * angle * distance - 0.5 * angle**2 * variance)


def _geometric_power(first: NDArray[np.float64], second: NDArray[np.float64]) -> Shares:
    """Sum the geometric mean of two powers (windows, bands) over windows."""
    return np.sqrt(first * second).sum(axis=0)


def _ratio(values: Shares, scale: Shares) -> Shares:
    return np.where(scale > 0, values / np.where(scale > 0, scale, 1.0), 0.0)
