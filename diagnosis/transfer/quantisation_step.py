"""Steps of a disparity, told from the terraces that they leave in depth maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_BIN_PX = 1 / 1024  # Of the histogram; far below the least step.
_LEAST_PX, _MOST_PX = 1 / 48, 0.5  # Steps that are looked for.
_NEAR_PX = 256.0  # Disparity of what is so near that whole units of depth hide all steps.
_PERIODS = 16  # Frequencies in the width of a peak, for a step to be told to a thousandth.
_SHARE = 0.25  # Of one, that a peak has at least; depth in whole millimetres takes from it.
_ALIKE = 0.9  # Of the highest peak: half of a step makes one as high, and is none.


def step_px(maps: Sequence[NDArray[np.floating]]) -> float | None:
    """Tell the step of which disparities are whole multiples.

    Of disparities d on terraces of step s the mean of cos(2 pi d / s) is 1, of others near 0.

    Args:
        maps: disparity of one scene each [px], none below 0; NaN where there is none. All count
            alike, and what is beyond 256 px does not.

    Returns:
        Step [px], between 1/48 and 1/2; None where there is none.
    """
    known = [values for one in maps if (values := one[one < _NEAR_PX]).size]
    if not known:
        return None
    bins = int(max(one.max() for one in known) / _BIN_PX) + 2
    counts = [np.bincount(np.rint(one / _BIN_PX).astype(int), minlength=bins) for one in known]
    share = np.mean([count / count.sum() for count in counts], axis=0)
    size = 1 << (_PERIODS * bins).bit_length()
    mean = np.fft.rfft(share, size).real
    frequency = np.arange(len(mean)) / (size * _BIN_PX)
    mean[(frequency < 1 / _MOST_PX) | (frequency > 1 / _LEAST_PX)] = 0.0
    if mean.max() < _SHARE:
        return None
    first = int(np.argmax(mean > _ALIKE * mean.max()))
    top = first + int(np.argmax(mean[first : first + _PERIODS]))
    return float(1 / frequency[top])
