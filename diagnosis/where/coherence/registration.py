"""Registration of a right image on the left one, window by window.

The reference disparity is wrong by tenths of a pixel, and imagers are turned against each other.
Both would make common structure look like noise. Each window with common structure is therefore
shifted. Windows without it keep their place: the best of many shifts of noise correlates by chance.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence.sampling import sample_smooth
from starling.diagnosis.where.coherence.spectra import (
    BAND_NUMBER,
    COLUMN_FREQUENCY,
    ROW_FREQUENCY,
    STEP_PX,
    WINDOW_PX,
    Spectra,
    grid_shape,
)
from starling.sim.arrays import Image

_REACH_PX = 1.5  # Largest shift.
_GRID_PX = 0.25  # Step of the search, refined by a parabola.
_LEAST_CORRELATION = 0.2  # Six standard deviations of the correlation of independent noise.
_SMOOTHING_CELLS = 0.7  # Standard deviation of the filter over neighbouring windows.
_TRIED_PX = np.arange(-_REACH_PX, _REACH_PX + _GRID_PX / 2, _GRID_PX)
_USED = BAND_NUMBER < 3  # Periods up to 16 px; coarser shading has a broad peak.


def window_shifts(left: Spectra, right: Spectra) -> NDArray[np.float64]:
    """Estimate by how much the content of the right windows has to move.

    Args:
        left: (windows, rows, columns).
        right: of the same windows.

    Returns:
        (windows, 2) right and down [px]: left(x) is like right(x + shift). NaN without a clear
        peak.
    """
    shifts = np.full((len(left), 2), np.nan)
    if not len(left):
        return shifts
    used = np.where(_USED, np.where(COLUMN_FREQUENCY > 0, 2.0, 1.0), 0.0)
    power = np.sqrt(_power(left, used) * _power(right, used))
    product = left * right.conj() * used.astype(np.float32)
    across = np.exp(-2j * np.pi * COLUMN_FREQUENCY.T * _TRIED_PX).astype(np.complex64)
    down = np.exp(-2j * np.pi * ROW_FREQUENCY * _TRIED_PX).T.astype(np.complex64)
    correlation = np.real(down @ (product @ across)) / np.maximum(power, 1e-12)[:, None, None]
    for window, values in enumerate(correlation):
        row, column = np.unravel_index(int(np.argmax(values)), values.shape)
        inside = 0 < row < len(_TRIED_PX) - 1 and 0 < column < len(_TRIED_PX) - 1
        if inside and values[row, column] >= _LEAST_CORRELATION:
            offsets = (
                _vertex(values[row, column - 1 : column + 2]),
                _vertex(values[row - 1 : row + 2, column]),
            )
            shifts[window] = np.array((_TRIED_PX[column], _TRIED_PX[row])) + offsets
    return shifts


def shift_map(
    shifts: NDArray[np.float64], cells: NDArray[np.intp], shape: tuple[int, ...]
) -> Image:
    """Interpolate the shifts of windows to pixels (h, w, 2); 0 where none is known.

    Args:
        shifts: (windows, 2), NaN where unknown.
        cells: grid cells of the windows.
        shape: of the image.
    """
    known = np.isfinite(shifts).all(axis=1)
    grid = np.zeros((*grid_shape(shape), 3), np.float32)
    place = np.unravel_index(cells[known], grid.shape[:2])
    grid[place] = np.column_stack([shifts[known], np.ones(np.count_nonzero(known))])
    grid = cv2.GaussianBlur(grid, (0, 0), _SMOOTHING_CELLS, borderType=cv2.BORDER_CONSTANT)
    grid = np.where(grid[..., 2:] > 0, grid / np.maximum(grid[..., 2:], 1e-6), 0)[..., :2]
    y, x = (np.indices(shape[:2], np.float32) - (WINDOW_PX - 1) / 2) / STEP_PX
    return sample_smooth(np.ascontiguousarray(grid), x, y)


def _power(spectra: Spectra, used: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("nyx,yx->n", np.abs(spectra) ** 2, used)


def _vertex(values: NDArray) -> float:
    """Return the offset of a parabola's vertex from the middle of three values [px]."""
    before, middle, after = map(float, values)
    curvature = 2 * middle - before - after
    return _GRID_PX * 0.5 * (after - before) / curvature if curvature > 0 else 0.0
