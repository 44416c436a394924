"""What whole codes do to noise: the variance that is read, and back to the one that was there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_HARMONICS = np.arange(1, 33, dtype=np.float64)  # 33 on change the variance by less than 5e-4.
_LARGEST = 1e8  # Variance [DN^2] beyond every converter's range.


def read(variance_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance in time of whole codes, over pixels whose levels lie anywhere within a step.

    Noise of variance v has, with the converter's error, the mean square v + 1/12. What of
    it stands still in each pixel, the deviation of its mean code, is not seen in time: by the
    rounding error's Fourier series that is the sum of exp(-4 pi^2 k^2 v) / (2 pi^2 k^2).

    Args:
        variance_dn2: of normal noise before the converter [DN^2], any shape.

    Source: Widrow and Kollar, Quantization Noise (2008), ch. 4 and 5 (characteristic function).
    """
    squared = (np.pi * _HARMONICS) ** 2
    still = np.exp(-4 * squared * variance_dn2[..., None]) / (2 * squared)
    # The series at 0 is exactly 1/12: what the harmonics left out hold is the rest.
    rest = 1 / 12 - (1 / (2 * squared)).sum()
    return variance_dn2 + 1 / 12 - still.sum(axis=-1) - np.where(variance_dn2 == 0, rest, 0)


def before(read_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance before the converter [DN^2], given that of its codes (see `read`); 0 at least."""
    wanted = np.asarray(read_dn2, np.float64)
    low, high = np.zeros_like(wanted), np.minimum(np.maximum(wanted, 0) + 1, _LARGEST)
    for _ in range(60):
        middle = (low + high) / 2
        over = read(middle) > wanted
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return np.where(wanted > 0, (low + high) / 2, 0.0)
