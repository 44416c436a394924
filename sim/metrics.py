"""Error figures of a disparity map against a reference, and the pixels that they count."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from starling.patterns.errors import refuse
from starling.sim.arrays import filled

EDGE_JUMP_PX = 1.0  # A larger disparity step between neighbours is a depth edge [px].
EDGE_MARGIN_PX = 2  # Margin around depth edges, where the reference is uncertain [px].
LEFT_BAND_PX = 128  # Left columns that a search of 128 disparities may not reach.
_LEAST_COMPARED = 1000  # Pixels that a ratio of two maps needs.
_SAME_RATIO = 3e-3  # Ratios of calibrations of one device differ from 1 by less.
_CLEARLY = 0.7  # A factor explains a difference if it leaves less of it than an offset does.
MAD_TO_SIGMA = 1.4826  # Standard deviation / median absolute deviation of a normal law.


@dataclass(frozen=True, kw_only=True, slots=True)
class DisparityFigures:
    """Error figures of a disparity map."""

    bias_px: float  # Median error [px].
    nmad_px: float  # 1.4826 x median absolute deviation of the error from its median [px].
    bad1_pct: float  # Share of valid pixels with an error above 1 px [percent].
    fill: float  # Share of the counted pixels that are valid, 0 ... 1.
    ndp_iou: float | None  # Overlap of both maps' no-depth pixels, 0 ... 1, if requested.


def _one_shape(**arrays: NDArray) -> None:
    shapes = [array.shape for array in arrays.values()]
    if len(set(shapes)) > 1:
        raise refuse(
            " and ".join(arrays),
            "must share one shape",
            " and ".join(map(str, shapes)),
            "Compare maps of one view.",
        )


def depth_edges(disparity_px: NDArray) -> NDArray[np.bool_]:
    """Pixels within 2 px of a depth edge of a disparity map.

    Unknown pixels first take the nearest known value, so that a hole is not an edge.

    Args:
        disparity_px: (h, w) [px], NaN where unknown.

    Returns:
        (h, w) mask, all False if no pixel is known.
    """
    known = np.isfinite(disparity_px)
    if not known.any():
        return np.zeros(known.shape, bool)
    whole = filled(disparity_px, known)
    edge = np.zeros(known.shape, np.uint8)
    across = np.abs(np.diff(whole, axis=1)) > EDGE_JUMP_PX
    down = np.abs(np.diff(whole, axis=0)) > EDGE_JUMP_PX
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    side = 2 * EDGE_MARGIN_PX + 1
    return cv2.dilate(edge, np.ones((side, side), np.uint8)).astype(bool)


def reached_pixels(truth_px: NDArray) -> NDArray[np.bool_]:
    """Pixels of known truth outside the left band, where no-depth pixels are compared.

    Images that the left band covers are reported by a warning.
    """
    reached = np.isfinite(truth_px)
    if reached.shape[1] <= LEFT_BAND_PX:
        message = f"images of {reached.shape[1]} columns: the first {LEFT_BAND_PX} are not compared"
        warnings.warn(f"{message}. Take wider images.", stacklevel=1)
    reached[:, :LEFT_BAND_PX] = False
    return reached


def scored_pixels(truth_px: NDArray) -> NDArray[np.bool_]:
    """Pixels that count: known truth, outside the left band, away from depth edges.

    Args:
        truth_px: (h, w) disparity of the reference [px], NaN where unknown.
    """
    return reached_pixels(truth_px) & ~depth_edges(truth_px)


def hole_overlap(first_px: NDArray, second_px: NDArray, where: NDArray[np.bool_]) -> float:
    """Intersection over union of two maps' no-depth pixels in `where`.

    1 if neither map has one, NaN if `where` is empty.
    """
    if not where.any():
        return float("nan")
    first, second = ~np.isfinite(first_px) & where, ~np.isfinite(second_px) & where
    union = np.count_nonzero(first | second)
    return np.count_nonzero(first & second) / union if union else 1.0


def disparity_figures(
    disparity_px: NDArray,
    reference_px: NDArray,
    scored: NDArray[np.bool_],
    *,
    holes_of_px: NDArray | None = None,
    holes_where: NDArray[np.bool_] | None = None,
) -> DisparityFigures:
    """Compare a disparity map with a reference.

    Args:
        disparity_px: (h, w) [px], NaN = no depth.
        reference_px: (h, w) [px], NaN = unknown. A scanner's truth, or a device's own map.
        scored: (h, w) pixels that count, usually `scored_pixels(truth)`.
        holes_of_px: Map whose no-depth pixels are compared with those of `disparity_px`, or None.
        holes_where: Pixels of this comparison, usually `reached_pixels(truth)`; None = `scored`.

    Returns:
        Figures over the pixels where both maps have a value; NaN if there are none.

    Raises:
        InputError: if the arrays differ in shape or `scored` is empty.
    """
    _one_shape(disparity_px=disparity_px, reference_px=reference_px, scored=scored)
    if not scored.any():
        raise refuse("scored", "must hold a pixel", 0, "Take a scene with known truth.")
    error = (disparity_px - reference_px)[scored & np.isfinite(disparity_px + reference_px)]
    bias = float(np.median(error)) if error.size else float("nan")
    spread = MAD_TO_SIGMA * float(np.median(np.abs(error - bias))) if error.size else float("nan")
    overlap = None
    if holes_of_px is not None:
        where = scored if holes_where is None else holes_where
        _one_shape(disparity_px=disparity_px, holes_of_px=holes_of_px, holes_where=where)
        overlap = hole_overlap(disparity_px, holes_of_px, where)
    return DisparityFigures(
        bias_px=bias,
        nmad_px=spread,
        bad1_pct=100 * float(np.mean(np.abs(error) > 1)) if error.size else float("nan"),
        fill=np.count_nonzero(np.isfinite(disparity_px) & scored) / np.count_nonzero(scored),
        ndp_iou=overlap,
    )


def constant_ratio(disparity_px: NDArray, reference_px: NDArray) -> float | None:
    """Ratio of two disparity maps, if they differ by one factor and not by one offset.

    Args:
        disparity_px: (h, w) [px], NaN = no depth.
        reference_px: (h, w) [px], NaN = unknown.

    Returns:
        Median of `disparity_px` over `reference_px`. None if it is within 0.3 % of 1, too few
        pixels are known, or an offset explains the difference as well.
    """
    known = np.isfinite(disparity_px + reference_px) & (reference_px > 0)
    if known.sum() < _LEAST_COMPARED:
        return None
    disparity, reference = disparity_px[known], reference_px[known]
    ratio = float(np.median(disparity / reference))
    difference = disparity - reference

    def spread(rest: NDArray) -> float:
        return float(np.median(np.abs(rest)))

    scaled, moved = (
        spread(disparity - ratio * reference),
        spread(difference - np.median(difference)),
    )
    return ratio if abs(ratio - 1) > _SAME_RATIO and scaled < _CLEARLY * moved else None


def shift_px(
    left: NDArray[np.floating], right: NDArray[np.floating], *, near_px: float, margin_px: int
) -> float:
    """Disparity of a fronto-parallel pair by least squares, without a matcher.

    The right image is shifted by cubic splines.

    Args:
        left: (h, w) noise-free image of the left imager.
        right: (h, w) noise-free image of the right imager.
        near_px: Approximate disparity, at most 0.5 px off.
        margin_px: Width of the excluded border.

    Returns:
        Shift [px] that minimises the squared difference of the images.
    """
    inside = (slice(margin_px, -margin_px), slice(margin_px, -margin_px))
    fixed, moving = np.asarray(left, np.float64), np.asarray(right, np.float64)

    def mismatch(disparity_px: float) -> float:
        shifted = ndimage.shift(moving, (0, disparity_px), order=3, mode="nearest")
        return float(((fixed - shifted)[inside] ** 2).sum())

    minimum = optimize.minimize_scalar(mismatch, (near_px - 0.5, near_px + 0.5), tol=1e-5)
    return float(minimum.x)
