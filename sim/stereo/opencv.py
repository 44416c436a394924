"""OpenCV's engines behind one small interface: StereoSGBM and StereoBM.

Both see the pair widened to the left by the search, so that disparities up to the search can be
tried from the first column on; without it OpenCV leaves the whole left band empty.
"""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.reason import Reason
from starling.sim.sensor.matcher import FIXED_POINT, Block, Checks, Matcher, SemiGlobalBlock

_MODES = {"3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY, "hh": cv2.STEREO_SGBM_MODE_HH}
_OFF = -1  # OpenCV's word for "no left-right check".


def _bytes(image: NDArray) -> NDArray[np.uint8]:
    """8 bits of an image: OpenCV's engines take no more."""
    return image if image.dtype == np.uint8 else (image >> 2).astype(np.uint8)


def _widened(image: NDArray, *, columns: int) -> NDArray:
    return cv2.copyMakeBorder(_bytes(image), 0, 0, columns, 0, cv2.BORDER_REPLICATE)


def _engine(matcher: Matcher, engine: SemiGlobalBlock | Block, checks: Checks):
    """OpenCV's object for the setting; the speckle filter is left to `starling.sim.stereo.checks`."""
    apart = checks.left_right_px
    apart = _OFF if apart >= matcher.search_px else int(apart)
    if isinstance(engine, SemiGlobalBlock):
        return cv2.StereoSGBM.create(
            matcher.min_disparity_px,
            matcher.search_px,
            engine.block_px,
            engine.small_penalty,
            engine.large_penalty,
            apart,
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
    block.setDisp12MaxDiff(apart)
    return block


def compute(
    left: NDArray, right: NDArray, matcher: Matcher, engine: SemiGlobalBlock | Block
) -> tuple[NDArray[np.float32], dict[Reason, NDArray[np.bool_]]]:
    """Run OpenCV's engine.

    Returns:
        (h, w) float32 disparities [px], NaN where the engine has none, and its causes. OpenCV does
        not say which of its checks failed; `_causes` reads it off the hole's shape.
    """
    columns = matcher.search_px + matcher.min_disparity_px
    pair = (_widened(left, columns=columns), _widened(right, columns=columns))
    fixed = _engine(matcher, engine, matcher.checks).compute(*pair)[:, columns:]
    disparity = decode(fixed, matcher.min_disparity_px)
    disagree, ambiguous = _causes(disparity)
    return disparity, {Reason.LEFT_RIGHT: disagree, Reason.AMBIGUOUS: ambiguous}


def decode(fixed: NDArray, min_disparity_px: int) -> NDArray[np.float32]:
    """Decode OpenCV's fixed point (1/16 px) to pixels: the only place where that is done.

    Values at or below the smallest disparity are OpenCV's mark of "none" or the search's own end;
    both become NaN.
    """
    disparity = fixed.astype(np.float32) / np.float32(FIXED_POINT)
    disparity[fixed <= min_disparity_px * FIXED_POINT] = np.nan
    return disparity


@nb.njit(cache=True)
def _causes(disparity):  # pragma: no cover - compiled
    """Why the engine's holes are there, by their shape along the row: disagreement, ambiguity.

    A hole whose right neighbour is nearer than its left one by about the hole's width is what the
    left-right check leaves of an occlusion; others count as ambiguous.
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
