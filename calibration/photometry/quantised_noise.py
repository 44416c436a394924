"""Effect of quantisation on temporal noise variance, and its inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_HARMONICS = np.arange(1, 33, dtype=np.float64)  # Higher ones change the variance by < 5e-4.
_LARGEST = 1e8  # Variance above any converter's range [DN^2].


def quantised_variance(variance_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the temporal variance of quantised codes, averaged over levels within a step.

    Noise of variance v and the quantisation error have the mean square v + 1/12. The part that is
    constant in time, the error of a pixel's mean code, is not visible in the temporal variance.
    By the Fourier series of the rounding error it is the sum of exp(-4 pi^2 k^2 v) / (2 pi^2 k^2).

    Args:
        variance_dn2: variance of normal noise before the converter [DN^2], any shape.

    Source: Widrow and Kollar, Quantization Noise (2008), ch. 4 and 5 (characteristic function).
    """
    squared = (np.pi * _HARMONICS) ** 2
    fixed = np.exp(-4 * squared * variance_dn2[..., None]) / (2 * squared)
    # The full series at 0 is exactly 1/12; the truncated harmonics hold the difference.
    truncation = 1 / 12 - (1 / (2 * squared)).sum()
    return variance_dn2 + 1 / 12 - fixed.sum(axis=-1) - np.where(variance_dn2 == 0, truncation, 0)


def unquantised_variance(quantised_dn2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert `quantised_variance` [DN^2]; the result is at least 0."""
    target = np.asarray(quantised_dn2, np.float64)
    low, high = np.zeros_like(target), np.minimum(np.maximum(target, 0) + 1, _LARGEST)
    for _ in range(60):
        middle = (low + high) / 2
        over = quantised_variance(middle) > target
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return np.where(target > 0, (low + high) / 2, 0.0)
