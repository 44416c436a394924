"""OpenCV's engines StereoSGBM and StereoBM.

Both images are extended to the left by the search range. All disparities can then be tried from
the first column on; otherwise OpenCV returns no disparity in the left band.
"""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.reason import Reason
from starling.sim.sensor.matcher import FIXED_POINT, Block, Checks, Matcher, SemiGlobalBlock

_MODES = {"3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY, "hh": cv2.STEREO_SGBM_MODE_HH}
_OFF = -1  # Disables OpenCV's left-right check.


def _bytes(image: NDArray) -> NDArray[np.uint8]:
    """Reduce an image to 8 bits, the most that OpenCV's engines accept."""
    return image if image.dtype == np.uint8 else (image >> 2).astype(np.uint8)


def _widened(image: NDArray, *, columns: int) -> NDArray:
    return cv2.copyMakeBorder(_bytes(image), 0, 0, columns, 0, cv2.BORDER_REPLICATE)


def _engine(matcher: Matcher, engine: SemiGlobalBlock | Block, checks: Checks):
    """Create OpenCV's matcher; speckle filtering is done by `starling.sim.stereo.checks`."""
    tolerance = checks.left_right_px
    tolerance = _OFF if tolerance >= matcher.search_px else int(tolerance)
    if isinstance(engine, SemiGlobalBlock):
        return cv2.StereoSGBM.create(
            matcher.min_disparity_px,
            matcher.search_px,
            engine.block_px,
            engine.small_penalty,
            engine.large_penalty,
            tolerance,
            engine.prefilter_cap,
            round(checks.uniqueness),
            0,
            0,
            _MODES[engine.mode],
        )
    block = cv2.StereoBM.create(matcher.search_px, engine.block_px)
    block.setMinDisparity(matcher.min_disparity_px)
    block.setPreFilterCap(engine.prefilter_cap)
    block.setTextureThreshold(0)
    block.setUniquenessRatio(round(checks.uniqueness))
    block.setDisp12MaxDiff(tolerance)
    return block


def compute(
    left: NDArray, right: NDArray, matcher: Matcher, engine: SemiGlobalBlock | Block
) -> tuple[NDArray[np.float32], dict[Reason, NDArray[np.bool_]]]:
    """Run OpenCV's engine.

    Returns:
        (h, w) float32 disparities [px], NaN without disparity, and masks of causes. OpenCV does
        not report which check failed; `_causes` infers it from the shape of the holes.
    """
    columns = matcher.search_px + matcher.min_disparity_px
    pair = (_widened(left, columns=columns), _widened(right, columns=columns))
    fixed = _engine(matcher, engine, matcher.checks).compute(*pair)[:, columns:]
    disparity = decode(fixed, matcher.min_disparity_px)
    disagree, ambiguous = _causes(disparity)
    return disparity, {Reason.LEFT_RIGHT: disagree, Reason.AMBIGUOUS: ambiguous}


def decode(fixed: NDArray, min_disparity_px: int) -> NDArray[np.float32]:
    """Decode OpenCV's fixed point (1/16 px) to pixels.

    Values at or below the smallest disparity mark missing disparities or the end of the search;
    they become NaN.
    """
    disparity = fixed.astype(np.float32) / np.float32(FIXED_POINT)
    disparity[fixed <= min_disparity_px * FIXED_POINT] = np.nan
    return disparity


@nb.njit(cache=True)
def _causes(disparity):  # pragma: no cover - compiled
    """Classify holes by their shape along the row as left-right disagreement or ambiguity.

    The left-right check turns an occlusion into a hole about as wide as the disparity step from its
    left to its right neighbour. All other holes count as ambiguous.
    """
    h, w = disparity.shape
    disagree = np.zeros((h, w), np.bool_)
    ambiguous = np.zeros((h, w), np.bool_)
    for y in range(h):
        start = 0
        for x in range(w + 1):
            if x < w and np.isnan(disparity[y, x]):
                continue
            near = disparity[y, x] if x < w else np.float32(0)
            far = disparity[y, start - 1] if start > 0 else near
            hidden = near - far > 1 and x - start <= 2 * (near - far) + 2
            disagree[y, start:x] = hidden
            ambiguous[y, start:x] = not hidden
            start = x + 1
    return disagree, ambiguous
