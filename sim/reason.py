"""Reason codes of pixels without depth. If several causes apply, the lowest code wins."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Reason(IntEnum):
    """Reason code of a pixel; 0 means depth. Stored as uint32, since OpenEXR has no uint8.

    The page on conventions explains each (`docs/conventions.md`, missing depth).

    Attributes:
        VALID: 0. The pixel has depth.
        NO_SURFACE: 1. The pixel's ray meets no surface.
        OUTSIDE_OVERLAP: 2. The match would lie left of the right image (left border).
        OCCLUDED: 3. The surface is hidden from the right imager.
        SHADOWED: 4. The surface is hidden from the projector.
        LOW_SIGNAL: 5. Too little light above the noise.
        SATURATED: 6. Too many pixels of the window are at the imager's ceiling.
        AMBIGUOUS: 7. A second disparity matches nearly as well (uniqueness).
        LEFT_RIGHT: 8. Matching from the right image gives another disparity.
        SUPPORT: 9. Too little texture, or too few neighbours that agree.
        SPECKLE: 10. A small island of its own disparity, removed.
        POST_FILTER: 11. Removed by post-processing.
        OUT_OF_RANGE: 12. Depth outside what the sensor reports.
        UNKNOWN: 13. A real device, which reports no reason, or a trained model.
    """

    VALID = 0
    NO_SURFACE = 1
    OUTSIDE_OVERLAP = 2
    OCCLUDED = 3
    SHADOWED = 4
    LOW_SIGNAL = 5
    SATURATED = 6
    AMBIGUOUS = 7
    LEFT_RIGHT = 8
    SUPPORT = 9
    SPECKLE = 10
    POST_FILTER = 11
    OUT_OF_RANGE = 12
    UNKNOWN = 13


LABELS: dict[Reason, str] = {
    Reason.VALID: "valid",
    Reason.NO_SURFACE: "no surface",
    Reason.OUTSIDE_OVERLAP: "outside the overlap",
    Reason.OCCLUDED: "occluded from the right imager",
    Reason.SHADOWED: "shadowed from the projector",
    Reason.LOW_SIGNAL: "too little signal",
    Reason.SATURATED: "saturated",
    Reason.AMBIGUOUS: "ambiguous match",
    Reason.LEFT_RIGHT: "left-right disagreement",
    Reason.SUPPORT: "too little support",
    Reason.SPECKLE: "speckle filter",
    Reason.POST_FILTER: "post filter",
    Reason.OUT_OF_RANGE: "out of range",
    Reason.UNKNOWN: "unknown",
}


def first_cause(valid: NDArray[np.bool_], causes: dict[Reason, NDArray[np.bool_]]) -> NDArray:
    """Assign its first cause to each pixel without depth.

    Args:
        valid: (h, w), True where there is depth.
        causes: Mask (h, w) of each cause. The lowest code wins; pixels without a cause are
            UNKNOWN.

    Returns:
        (h, w) uint32 codes, 0 exactly where `valid` is True.
    """
    reason = np.full(valid.shape, Reason.UNKNOWN, np.uint32)
    for cause in sorted(causes, reverse=True):
        reason[causes[cause]] = cause
    reason[valid] = Reason.VALID
    return reason
