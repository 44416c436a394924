"""Spectra of square windows on a fixed grid, and their sums over bands of periods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from starling.sim.arrays import Image, Mask

Spectra = NDArray[np.complex64]  # (windows, rows, columns) of each window, half plane.
Plane = NDArray[np.float64]  # (rows, columns) of the half plane of frequencies.

WINDOW_PX = 64
STEP_PX = 32  # With the taper, windows half a side apart are nearly independent.
_LEAST_KNOWN = 0.98  # Least share of known pixels in a window.
_TAPER_1D = np.sin(np.pi * (np.arange(WINDOW_PX) + 0.5) / WINDOW_PX) ** 2
_TAPER = (_TAPER_1D[:, None] * _TAPER_1D[None]).astype(np.float32)  # Hann's.
# The taper correlates neighbouring frequencies by 2/3 and 1/6 (Harris, Proc. IEEE 66, 1978).
_BINS_PER_SAMPLE = (1 + 2 * ((2 / 3) ** 2 + (1 / 6) ** 2)) ** 2


@dataclass(frozen=True, kw_only=True, slots=True)
class PeriodBand:
    """Range of periods."""

    name: str
    shortest_px: float
    longest_px: float


BANDS = (
    PeriodBand(name="2-4 px", shortest_px=2, longest_px=4),
    PeriodBand(name="4-8 px", shortest_px=4, longest_px=8),
    PeriodBand(name="8-16 px", shortest_px=8, longest_px=16),
    PeriodBand(name="16-33 px", shortest_px=16, longest_px=33),
    PeriodBand(name="> 33 px", shortest_px=33, longest_px=np.inf),
)

ROW_FREQUENCY = np.asarray(fft.fftfreq(WINDOW_PX)[:, None], np.float64)  # [px^-1]
COLUMN_FREQUENCY = np.asarray(fft.rfftfreq(WINDOW_PX)[None], np.float64)  # [px^-1]
_RADIAL = np.hypot(ROW_FREQUENCY, COLUMN_FREQUENCY)
# Number of frequencies of the whole plane that a bin of the half plane represents.
_WEIGHT = np.broadcast_to(
    np.where((COLUMN_FREQUENCY == 0) | (COLUMN_FREQUENCY == 0.5), 1.0, 2.0), _RADIAL.shape
)


def _band_numbers() -> NDArray[np.intp]:
    """Return the band of each frequency; the mean and the corners have a number of their own."""
    number = np.full(_RADIAL.shape, len(BANDS), np.intp)
    period = np.divide(1, _RADIAL, where=_RADIAL > 0, out=np.zeros(_RADIAL.shape))
    for index, band in enumerate(BANDS):
        inside = (period < band.longest_px) & (period >= band.shortest_px)
        number[inside] = index
    return number


BAND_NUMBER = _band_numbers()
# Independent complex samples of one window in each band.
SAMPLES = np.bincount(BAND_NUMBER.ravel(), _WEIGHT.ravel())[: len(BANDS)] / 2 / _BINS_PER_SAMPLE
_NO_POWERS = np.empty((0, len(BANDS)))


def by_frequency(values: NDArray[np.float64]) -> Plane:
    """Give each frequency the value of its band; 0 for the mean and the corners.

    Args:
        values: (bands,).
    """
    return np.append(values, 0.0)[BAND_NUMBER]


def band_sums(plane: NDArray) -> NDArray[np.float64]:
    """Sum a power or cross spectrum over each band, as a mean square per pixel.

    Args:
        plane: (rows, columns), sum over windows or mean; its real part counts.

    Returns:
        (bands,) in the unit of the plane's sum over windows.
    """
    weighted = np.real(plane) * _WEIGHT / (WINDOW_PX**2 * float(np.sum(_TAPER**2)))
    sums = np.bincount(BAND_NUMBER.ravel(), weighted.ravel())[: len(BANDS)]
    return np.asarray(sums, np.float64)


def window_powers(spectra: Spectra, factor: Plane) -> NDArray[np.float64]:
    """Return the mean square of each window by band (windows, bands).

    Args:
        spectra: of the windows.
        factor: (rows, columns) factor on each power spectrum.
    """
    power = np.abs(spectra) ** 2 * factor.astype(np.float32)
    return np.stack([band_sums(window) for window in power]) if len(power) else _NO_POWERS


def cells_within(known: Mask, *, least: float = _LEAST_KNOWN) -> NDArray[np.intp]:
    """Return the sorted numbers of grid cells whose window is known, but for a few pixels.

    Args:
        known: (h, w).
        least: least share of known pixels.
    """
    rows, columns = grid_shape(known.shape)
    if min(rows, columns) < 1:
        return np.empty(0, np.intp)
    total = np.pad(known.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    side = WINDOW_PX
    rows_summed = total[side:] - total[:-side]
    count = rows_summed[:, side:] - rows_summed[:, :-side]
    return np.flatnonzero(count[::STEP_PX, ::STEP_PX] >= least * side**2)


def grid_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the rows and columns of windows in an image (h, w)."""
    rows, columns = ((length - WINDOW_PX) // STEP_PX + 1 for length in shape[:2])
    return rows, columns


def windows(values: NDArray, cells: NDArray[np.intp]) -> NDArray:
    """Cut the windows of grid cells (cells, side, side) out of an image (h, w)."""
    side = (WINDOW_PX, WINDOW_PX)
    view = np.lib.stride_tricks.sliding_window_view(values, side)[::STEP_PX, ::STEP_PX]
    return view[np.unravel_index(cells, grid_shape(values.shape))]


def window_spectra(image: Image, known: Mask, cells: NDArray[np.intp]) -> Spectra:
    """Transform windows, each less its mean; unknown pixels count as the mean.

    Args:
        image: (h, w).
        known: (h, w).
        cells: grid cells from `cells_within`.
    """
    weight = _TAPER * windows(known, cells)
    cut = windows(np.where(known, image, 0).astype(np.float32), cells)
    mean = (cut * weight).sum(axis=(1, 2)) / weight.sum(axis=(1, 2))
    return np.asarray(fft.rfft2((cut - mean[:, None, None]) * weight), np.complex64)


def window_means(image: Image, known: Mask, cells: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the tapered mean of each window (cells,)."""
    weight = _TAPER * windows(known, cells)
    cut = windows(np.where(known, image, 0).astype(np.float32), cells)
    return np.asarray((cut * weight).sum(axis=(1, 2)) / weight.sum(axis=(1, 2)), np.float64)


def cross(first: Spectra, second: Spectra) -> NDArray[np.complex128]:
    """Sum the cross spectra of paired windows (rows, columns)."""
    return np.einsum("nyx,nyx->yx", first, second.conj()).astype(np.complex128)
