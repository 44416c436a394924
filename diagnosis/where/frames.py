"""Test whether a gap is fixed in the camera image, in the projector field, or in neither."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.rooms import FEWEST, LEVEL
from starling.diagnosis.where.maps import CAMERA, PROJECTOR, Frame, GapMap

FixedFrame = Frame | Literal["both"]

_MORE = 1.5  # Least ratio of agreement between the frames, as their cells differ in size.
# Quantities of each pipeline segment; the first with a fixed frame counts.
_QUANTITIES = {"image": ("infrared",), "depth": ("error", "holes"), "whole": ("error", "holes")}


def common_frame(maps: Sequence[GapMap], quantity: str) -> FixedFrame | None:
    """Find the frame in which rooms agree on the location of a gap.

    Effects of imager, lens and matcher are fixed in the camera image. Effects of the projector's
    dots and light are fixed in the projector field. Effects of a scene are fixed in neither.

    Args:
        maps: maps in both frames.
        quantity: quantity of the two maps to compare.

    Returns:
        The frame with significant agreement that significantly exceeds 1.5 times that in the
        other frame; "both" if neither frame exceeds the other so far; None without significant
        agreement, or with too few rooms.
    """
    agreement: dict[Frame, NDArray[np.float64]] = {
        each.frame: each.agreement for each in maps if each.quantity == quantity
    }
    if set(agreement) != {CAMERA, PROJECTOR}:
        return None
    first, second = sorted(agreement, key=lambda name: -np.nan_to_num(agreement[name]).mean())
    if not _significant(agreement[first]):
        return None
    if not _significant(agreement[first] - _MORE * np.maximum(agreement[second], 0.0)):
        return "both"
    return first


def segment_frame(maps: Sequence[GapMap], segment: str) -> FixedFrame | None:
    """Return the frame of the first quantity of a pipeline segment that has a fixed frame."""
    for quantity in _QUANTITIES[segment]:
        if (frame := common_frame(maps, quantity)) is not None:
            return frame
    return None


def _significant(values: NDArray[np.float64]) -> bool:
    """Whether the mean over rooms is significantly above zero.

    Each value is the mean over a room's pairs with all others, so values share pairs. The error is
    the jackknife error of a mean over pairs (Arvesen, Ann. Math. Stat. 40, 1969).
    """
    known = values[np.isfinite(values)]
    count = known.size
    if count < FEWEST:
        return False
    error = 2 * (count - 1) / (count - 2) * known.std(ddof=1) / np.sqrt(count)
    return bool(known.mean() > stats.t.ppf((1 + LEVEL) / 2, count - 1) * error)
