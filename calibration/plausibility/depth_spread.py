"""How far apart in depth the captures are: what a flat wall alone leaves open."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_SEEN_PX = 0.02  # Shift that an image can be trusted to show: a model's errors do not average.
_BASELINE = 0.01  # Share of the baseline that it may pass for.
_STEP_PX = 4  # Every fourth pixel will do.
_SIGMAS = 3.29  # From the 5th to the 95th percentile of a normal distribution.


def check(references_px: Iterable[NDArray]) -> tuple[str, ...]:
    """Say what captures of one distance alone cannot tell.

    A baseline longer by a share e moves the right image by e d, the imagers' yaw moves it by
    about a constant, and so do the projector's position and rotation its pattern: what tells them
    apart is how the disparity d = f b / z varies. With 0.02 px of error that does not average,
    the baseline is open by 0.02 px / sd(d); said is 1 % and more, sd(d) below 2 px. The spread
    is taken over all scenes together from the 5th to the 95th percentile, over 3.29; a captured
    room alone has 5 to 26 px.

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
        f"the captures show one distance only: disparities of {middle:.1f} px vary by "
        f"{spread:.2g} px. Baseline and yaw of the imagers, position, rotation and field of "
        "the projector, and focal length and distance cannot be told apart: capture a wall at "
        "a second distance, or a room.",
    )
