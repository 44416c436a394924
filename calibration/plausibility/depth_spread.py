"""Check that the captures span a range of depth."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_SEEN_PX = 0.02  # Systematic model error of an image shift, which does not average out.
_BASELINE = 0.01  # Permitted relative error of the baseline from that shift.
_STEP_PX = 4  # Sampling step of depth maps.
_SIGMAS = 3.29  # Distance of the 5th and 95th percentile of a normal distribution.


def check(references_px: Iterable[NDArray]) -> tuple[str, ...]:
    """Warn if the captures show a single distance.

    A relative baseline error e shifts the right image by e d, and yaw of an imager shifts it by
    about a constant. The projector's position and rotation shift its pattern in the same way.
    Only the variation of the disparity d = f b / z separates these parameters. A systematic error
    of 0.02 px gives a relative baseline error of 0.02 px / std(d). The limit is 1 %,
    at a std(d) of 2 px. Here std(d) is the range from the 5th to the 95th percentile of all
    scenes, divided by 3.29. A single captured room has 5 to 26 px.

    Args:
        references_px: (h, w) disparity of each scene [px], NaN where unknown.

    Returns:
        One warning or none.
    """
    sparse = [reference[::_STEP_PX, ::_STEP_PX].ravel() for reference in references_px]
    disparity = np.concatenate([d[np.isfinite(d)] for d in sparse]) if sparse else np.empty(0)
    if disparity.size == 0:
        return ()
    low, middle, high = np.percentile(disparity, (5, 50, 95))
    spread = float(high - low) / _SIGMAS
    if spread >= _SEEN_PX / _BASELINE:
        return ()
    return (
        f"the captures show one distance only: disparities around {middle:.1f} px vary by "
        f"{spread:.2g} px. These parameters cannot be separated: baseline and yaw of the imagers; "
        "position, rotation and field of the projector; focal length and distance. Capture a wall "
        "at a second distance, or a room.",
    )
