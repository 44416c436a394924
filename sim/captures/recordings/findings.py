"""What an import saw in the images, and what it refuses or warns of."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.recordings import checks, frame_images
from starling.sim.captures.recordings.checks import PairFigures
from starling.sim.captures.recordings.statement import Geometry
from starling.sim.stereo.depth import from_code

# Share of light in spots: 0.037 to 0.26 with dots, 0.014 to 0.016 without, up to 0.08 in noise.
_DOTTED = 0.03
_PLAIN = 0.02
_WINDOWS = 54  # Half of the windows: noise has spots, but none that both images share.
_UNRECTIFIED_PX = 1.0  # A D415 has 0.3 px.
_SKEWED_PX = 0.6
_FAR_DEPTH = 1.25  # Ratio of depth to f b / d beyond which its unit is wrong; devices: 1.02.
_OFF_DEPTH = 1.05
_COARSE_PX = 8  # Images are compared at this step, above their noise.
_EVEN = 0.02  # An image with a smaller relative spread has no structure.
_STILL = 0.1  # Loss of correlation from the first to the last frame of a static scene.


def findings(
    sampled: Sequence[Mapping[str, NDArray[Any]]], known: Geometry, unit_m: float, step_m: float
) -> dict[str, Any]:
    """Measure a few frames.

    Returns:
        `{"dots": "yes" | "no" | "unclear", "dot_share", "windows", "row_offset_px",
        "row_spread_px", "disparity_px", "depth_ratio", "is_still"}`; None where it is unknown.
    """
    pairs = [images for images in sampled if "left" in images]
    shares = [checks.dot_share(images["left"]) for images in pairs]
    figures = [_figures(images, known, unit_m, step_m) for images in pairs if "right" in images]
    best = max(figures, key=lambda row: row.windows, default=PairFigures(windows=0))
    share = float(np.median(shares)) if shares else None
    return {
        "dots": _dots(share, best.windows, has_right=bool(figures)),
        "dot_share": None if share is None else round(share, 4),
        "windows": best.windows,
        "row_offset_px": _rounded(best.row_offset_px),
        "row_spread_px": _rounded(best.row_spread_px),
        "disparity_px": _rounded(best.disparity_px),
        "depth_ratio": _rounded(best.depth_ratio),
        "is_still": _is_still([images["left"] for images in pairs]),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _figures(
    images: Mapping[str, NDArray[Any]], known: Geometry, unit_m: float, step_m: float
) -> PairFigures:
    depth_m = None
    if "depth" in images:
        depth_m = from_code(frame_images.codes(images["depth"], unit_m, step_m), step_m)
    return checks.pair_figures(
        images["left"],
        images["right"],
        depth_m=depth_m,
        focal_baseline_px_m=known.camera.fx_px * known.baseline_m,
    )


def _dots(share: float | None, windows: int, *, has_right: bool) -> str:
    if share is None:
        return "unclear"
    if share < _PLAIN or (has_right and windows < _WINDOWS / 2):
        return "no"
    return "yes" if share > _DOTTED and (windows >= _WINDOWS or not has_right) else "unclear"


def _is_still(images: Sequence[NDArray[Any]]) -> bool | None:
    """Whether first and last image show the same; None if there is one, or no structure."""
    if len(images) < 2:
        return None
    scale, mean = 1 / _COARSE_PX, cv2.INTER_AREA
    first, last = (
        cv2.resize(images[place].astype(np.float32), None, fx=scale, fy=scale, interpolation=mean)
        for place in (0, -1)
    )
    if min(image.std() / max(float(image.mean()), 1.0) for image in (first, last)) < _EVEN:
        return None
    return bool(np.corrcoef(first.ravel(), last.ravel())[0, 1] > 1 - _STILL)


def refuse_or_warn(
    seen: Mapping[str, Any], emitter: str, *, is_rectified: bool, is_moving: bool
) -> None:
    """Refuse pairs that no verb can use, and warn of contradictions.

    Raises:
        InputError: if rows are not aligned, left and right are swapped, or depth contradicts the
            disparity by far.
    """
    spread, ratio = seen["row_spread_px"], seen["depth_ratio"]
    disparity = seen["disparity_px"]
    if spread is not None and spread > _UNRECTIFIED_PX:
        rule = f"must be rectified, with rows within {_UNRECTIFIED_PX:g} px"
        advice = (
            "Is the calibration that of this camera?"
            if is_rectified
            else "Give the distortion of both imagers, and --rectify."
        )
        raise errors.refuse("pair", rule, f"{spread:.2f} px", advice)
    if disparity is not None and disparity < 0:
        rule, advice = "must have the left image first", "Swap --left and --right."
        raise errors.refuse("pair", rule, f"a median disparity of {disparity:.1f} px", advice)
    if ratio is not None and not 1 / _FAR_DEPTH <= ratio <= _FAR_DEPTH:
        rule = "must agree with focal length times baseline over disparity"
        got = f"{ratio:.4g} times that"
        advice = "Is the depth unit right (--depth-unit 0.0001 for a D405), and the baseline?"
        raise errors.refuse("depth", rule, got, advice)
    if ratio is not None and not 1 / _OFF_DEPTH <= ratio <= _OFF_DEPTH:
        _warn(f"depth is {ratio:.3f} times what the infrared pair gives. Is the baseline right?")
    if spread is not None and spread > _SKEWED_PX:
        _warn(f"rows of left and right differ by up to {spread:.2f} px.")
    if emitter == "on" and seen["dots"] == "no":
        _warn("the emitter is on, but the images show no dots.")
    if emitter == "off" and seen["dots"] == "yes":
        _warn("the emitter is off, but the images show dots.")
    if seen["is_still"] is False and not is_moving:
        _warn("first and last frame differ. If the camera or scene moves, give --moving.")


def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=3)
