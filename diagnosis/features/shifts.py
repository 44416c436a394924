"""Features of dot positions: left against right image, and left against expected image."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Image, Strata

STEP_PX = 0.7  # Shift to both sides of the expected position.
_WINDOW_PX = 15  # Side of the window in which images are standardised.
_MOST = 0.95  # Factor on a correlation: keeps its Fisher transform finite for equal images.
_RELIABLE = 0.3  # Correlation below which the position of its peak is chance.
_BINS = ("depth", "x", "y")
_STEPS = {"": (0, 0), "+x": (1, 0), "-x": (-1, 0), "+y": (0, 1), "-y": (0, -1)}
_SCENES = 16  # Scenes whose standardised expected images are cached.


def pair_shift_features(left: Image, right: Image, strata: Strata) -> dict[str, float]:
    """Correlate the left image with the right image, warped by the reference disparity."""
    return _shift_features("pair", left, _shifted(right, strata.disparity_px), strata)


def dot_shift_features(left: Image, strata: Strata) -> dict[str, float]:
    """Correlate the left image with the expected image."""
    return _shift_features("dots", left, _shifted_expected(strata), strata)


def warp_to_left(image: Image, disparity_px: Image, dx: float = 0.0, dy: float = 0.0) -> Image:
    """Warp a right image (h, w) into the left view; `dx`, `dy` shift right and down [px]."""
    y, x = np.indices(image.shape, np.float32)
    return np.asarray(
        cv2.remap(
            np.asarray(image, np.float32),
            np.asarray(x - np.nan_to_num(disparity_px) + dx, np.float32),
            np.asarray(y + dy, np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def _shifted(image: Image, disparity_px: Image) -> dict[str, Image]:
    """Warp an image into the left view at the expected position and a step to each side."""
    return {
        name: _standardise(warp_to_left(image, disparity_px, dx * STEP_PX, dy * STEP_PX))
        for name, (dx, dy) in _STEPS.items()
    }


@lru_cache(maxsize=_SCENES)
def _shifted_expected(strata: Strata) -> dict[str, Image]:
    """Shift the expected image; cached because all observations of a scene use it."""
    return _shifted(strata.expected, np.zeros_like(strata.disparity_px))


def _shift_features(
    kind: str, image: Image, shifted: Mapping[str, Image], strata: Strata
) -> dict[str, float]:
    """Compute height, position and width in x and y of the correlation peak, by bin."""
    flat = _standardise(image)
    products = {step: flat * partner for step, partner in shifted.items()}
    powers = flat**2, shifted[""] ** 2
    features = {}
    for name, where in (*strata.all_pixels(interior=True), *strata.bins(*_BINS, interior=True)):
        means = {step: bins.mean(product, where) for step, product in products.items()}
        power = float(np.prod([bins.mean(square, where) for square in powers]))
        correlation = means[""] / np.sqrt(max(power, 1e-6))
        features[f"{kind}.match.{name}"] = float(np.arctanh(_MOST * np.clip(correlation, -1, 1)))
        reliable = correlation > _RELIABLE
        for axis in ("x", "y"):
            curvature = means[f"+{axis}"] + means[f"-{axis}"] - 2 * means[""]
            slope = 0.5 * (means[f"+{axis}"] - means[f"-{axis}"])
            if not reliable or curvature > -1e-3:
                continue
            shift_px = -STEP_PX * slope / curvature
            features[f"{kind}.shift {axis}.{name}"] = float(np.clip(shift_px, -3, 3))
            features[f"{kind}.width {axis}.{name}"] = bins.log(-curvature / means[""])
    return features


def _standardise(image: Image) -> Image:
    """Subtract the local mean and divide by the local standard deviation."""
    fine = np.asarray(image, np.float32)
    mean = bins.smooth(fine, _WINDOW_PX)
    variance = bins.smooth(fine**2, _WINDOW_PX) - mean**2
    return np.asarray((fine - mean) / np.sqrt(np.maximum(variance, 1e-3)), np.float32)
