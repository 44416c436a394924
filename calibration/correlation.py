"""Local normalisation and cross-correlation of infrared images, independent of brightness."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse

Array = NDArray[np.float32]
Floats = NDArray[np.floating[Any]]

NEIGHBOURHOOD_PX = 6.0  # Sigma of the subtracted local mean; covers several dots.
DEVIATION_PX = 10.0  # Sigma of the window of the local variance.
WINDOW_PX = 31  # Side of a window; holds about 25 dots of a D415, 5 of a D435.
STRIDE_PX = 16
# Deviation over the image's largest value; a smaller deviation is rounding.
_FAINTEST = 1e-4


def local_mean(image: Floats) -> Floats:
    """Return the local mean (h, w), weighted by a Gaussian of sigma 6 px."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), NEIGHBOURHOOD_PX), image.dtype)


def without_mean(image: Floats) -> Floats:
    """Subtract the local mean (h, w); dots and texture remain, shading does not."""
    return image - local_mean(image)


def local_square(image: Floats) -> Floats:
    """Return the local mean square (h, w); Gaussian of sigma 10 px."""
    return np.asarray(cv2.GaussianBlur(image * image, (0, 0), DEVIATION_PX), image.dtype)


def high_passed(image: NDArray) -> Array:
    """Subtract the local mean and divide by the local deviation.

    The result does not depend on gain, on slow shading and, within 1e-3, on an offset. It is 0
    where the image is constant.

    Args:
        image: (h, w), any scale, finite.

    Returns:
        (h, w) with local mean about 0 and local mean square about 1.

    Raises:
        InputError: if a value is not finite.
    """
    image = np.asarray(image, np.float32)
    if not np.isfinite(image).all():
        raise refuse(
            "image",
            "must be finite",
            f"{np.count_nonzero(~np.isfinite(image))} pixels that are not",
            "Fill them and exclude them from `usable`.",
        )
    varying = without_mean(image)
    energy = local_square(varying)
    floor = _FAINTEST * float(np.abs(image).max(initial=0.0)) + np.finfo(np.float32).tiny
    return np.asarray(varying / np.sqrt(energy + np.float32(floor) ** 2 + 1e-30), np.float32)


def local_ncc(first: NDArray, second: NDArray, usable: NDArray[np.bool_]) -> Array:
    """Normalised cross-correlation of two images in windows of 31 x 31 px every 16 px.

    All pixels of a window must be usable. Pass pixels inside both images and away from depth
    edges (`starling.sim.metrics.depth_edges`). The score does not depend on gain and offset. A
    window in which either image is constant scores 0.

    Args:
        first: (h, w), usually `high_passed`.
        second: (h, w), usually `high_passed`.
        usable: (h, w) mask; images may hold any value outside it, including NaN.

    Returns:
        (n,) in [-1, 1], row by row; n = 0 if no window is usable.

    Raises:
        InputError: if the arrays differ in shape.
    """
    if not first.shape == second.shape == usable.shape:
        raise refuse(
            "first, second and usable",
            "must share one shape",
            f"{first.shape}, {second.shape}, {usable.shape}",
            "Compare images of one view.",
        )
    if min(first.shape) < WINDOW_PX:
        return np.empty(0, np.float32)
    left = np.where(usable, first, 0).astype(np.float64)
    right = np.where(usable, second, 0).astype(np.float64)
    whole = _means(usable.astype(np.float64)) > 1 - 0.5 / WINDOW_PX**2
    mean_left, mean_right = _means(left)[whole], _means(right)[whole]
    square_left, square_right = _means(left * left)[whole], _means(right * right)[whole]
    variance_left, variance_right = square_left - mean_left**2, square_right - mean_right**2
    covariance = _means(left * right)[whole] - mean_left * mean_right
    # A smaller variance is rounding of the mean square.
    varies = (variance_left > 1e-10 * square_left) & (variance_right > 1e-10 * square_right)
    product = np.where(varies, variance_left * variance_right, 1.0)
    return np.where(varies, np.clip(covariance / np.sqrt(product), -1, 1), 0).astype(np.float32)


def right_in_left(right: NDArray, disparity_px: NDArray) -> tuple[Array, NDArray[np.bool_]]:
    """Warp the right image into the left view by a disparity map (cubic interpolation).

    Args:
        right: (h, w).
        disparity_px: (h, w) x_left - x_right [px] of the left view, NaN where unknown.

    Returns:
        The warped image (h, w), and the mask (h, w) of pixels whose disparity is known and points
        into the right image. Outside the mask the image repeats the border.
    """
    height, width = disparity_px.shape
    known = np.isfinite(disparity_px)
    x = np.arange(width, dtype=np.float32) - np.where(known, disparity_px, 0)
    y = np.broadcast_to(np.arange(height, dtype=np.float32)[:, None], x.shape)
    # The integers in cv2.remap overflow for coordinates of millions of pixels.
    map_x = np.clip(x, -2 * width, 3 * width).astype(np.float32)
    warped = cv2.remap(
        np.asarray(right, np.float32),
        map_x,
        np.ascontiguousarray(y),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped, np.float32), known & (x >= 0) & (x <= width - 1)


def _means(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over each window inside the image, (rows, columns) of windows."""
    margin = WINDOW_PX // 2
    mean = cv2.boxFilter(image, cv2.CV_64F, (WINDOW_PX, WINDOW_PX))
    return np.asarray(mean, np.float64)[margin:-margin:STRIDE_PX, margin:-margin:STRIDE_PX]
