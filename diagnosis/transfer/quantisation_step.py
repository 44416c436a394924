"""Estimation of a matcher's disparity step from the terraces in its depth maps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

_BIN_PX = 1 / 1024  # Bin width of the histogram, far below the smallest step.
_LEAST_PX, _MOST_PX = 1 / 48, 0.5  # Range of the search.
_NEAR_PX = 256.0  # Larger disparities are ignored: there, whole units of depth hide the steps.
_PERIODS = 16  # Frequency samples per width of a peak: resolves a step to a thousandth.
_LEAST_PEAK = 0.25  # Least height of the peak, at most 1; depth in whole millimetres lowers it.
_EQUAL_PEAK = 0.9  # Share of the highest peak: half of a step has an equal peak, but is no step.


def estimate_step_px(maps: Sequence[NDArray[np.floating]]) -> float | None:
    """Estimate the step that divides all disparities.

    The mean of cos(2 pi d / s) over disparities d is 1 if s is their step, and else near 0.

    Args:
        maps: disparity of each scene [px], not negative; NaN where invalid. Scenes have equal
            weight.

    Returns:
        Step [px], between 1/48 and 1/2; None if there is none.
    """
    largest = [float(values.max()) for values in _near(maps)]
    if not largest:
        return None
    bins = int(max(largest) / _BIN_PX) + 2
    share = np.zeros(bins)
    for values in _near(maps):
        count = np.bincount(np.rint(values / _BIN_PX).astype(int), minlength=bins)
        share += count / count.sum()
    share /= len(largest)
    size = 1 << (_PERIODS * bins).bit_length()
    mean = np.fft.rfft(share, size).real
    frequency = np.arange(len(mean)) / (size * _BIN_PX)
    mean[(frequency < 1 / _MOST_PX) | (frequency > 1 / _LEAST_PX)] = 0.0
    if mean.max() < _LEAST_PEAK:
        return None
    first = int(np.argmax(mean > _EQUAL_PEAK * mean.max()))
    top = first + int(np.argmax(mean[first : first + _PERIODS]))
    return float(1 / frequency[top])


def _near(maps: Sequence[NDArray[np.floating]]) -> Iterator[NDArray[np.floating]]:
    """Yield the disparities of each scene that has some of use."""
    for disparity in maps:
        values = disparity[disparity < _NEAR_PX]
        if values.size:
            yield values
