"""Whether a gap stays at its place in the image, in the projector's field, or in neither."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.rooms import FEWEST, LEVEL
from starling.diagnosis.where.maps import CAMERA, PROJECTOR, Frame, Map

Stays = Frame | Literal["both"]

_MORE = 1.5  # Times as much as in the other frame, whose cells are of another size.
# Quantities that tell of an arm, the first that stays anywhere.
_TELLS = {"image": ("infrared",), "depth": ("error", "holes"), "whole": ("error", "holes")}


def frame(maps: Sequence[Map], quantity: str) -> Stays | None:
    """Tell in which frame rooms agree about where a gap is.

    That of the camera holds what imager, lens and matcher do, that of the projector what its dots
    and light do; what differs from scene to scene stays in neither.

    Args:
        maps: of both frames.
        quantity: that of two of them.

    Returns:
        The frame in which rooms' maps surely agree, and surely by half as much again as in the
        other; "both" where they surely agree and in neither so much more; None where they do not,
        or rooms are too few.
    """
    each: dict[Frame, NDArray[np.float64]] = {
        one.frame: one.agreement for one in maps if one.quantity == quantity
    }
    if set(each) != {CAMERA, PROJECTOR}:
        return None
    first, second = sorted(each, key=lambda name: -np.nan_to_num(each[name]).mean())
    if not _surely(each[first]):
        return None
    if not _surely(each[first] - _MORE * np.maximum(each[second], 0.0)):
        return "both"
    return first


def of_arm(maps: Sequence[Map], arm: str) -> Stays | None:
    """Tell the frame of the first quantity that tells of an arm and stays anywhere."""
    for quantity in _TELLS[arm]:
        if (found := frame(maps, quantity)) is not None:
            return found
    return None


def _surely(values: NDArray[np.float64]) -> bool:
    """Whether the mean over rooms is above zero beyond chance.

    Each value is the mean over a room's pairs with all others, so values share pairs: the error is
    the jackknife's of a mean over pairs (Arvesen, Ann. Math. Stat. 40, 1969).
    """
    known = values[np.isfinite(values)]
    count = known.size
    if count < FEWEST:
        return False
    error = 2 * (count - 1) / (count - 2) * known.std(ddof=1) / np.sqrt(count)
    return bool(known.mean() > stats.t.ppf((1 + LEVEL) / 2, count - 1) * error)
