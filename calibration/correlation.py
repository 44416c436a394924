"""How much two infrared images agree locally, whatever their brightness: dots and texture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import detail
from starling.patterns.errors import refuse

Array = NDArray[np.float32]

WINDOW_PX = 31  # Side of a window; holds some 25 of a D415's dots, 5 of a D435's.
STRIDE_PX = 16
_FAINTEST = 1e-4  # Of the image's largest value: a deviation below is rounding, not contrast.


def high_passed(image: NDArray) -> Array:
    """Subtract the local mean and divide by the local deviation (see `starling.calibration.detail`).

    Gain and slow shading drop out, and to 1e-3 an offset; where nothing varies the result is 0.

    Args:
        image: (h, w), any scale, finite.

    Returns:
        (h, w), local mean about 0 and local mean square about 1.

    Raises:
        InputError: if a value is not finite.
    """
    image = np.asarray(image, np.float32)
    if not np.isfinite(image).all():
        raise refuse(
            "image",
            "must be finite",
            f"{np.count_nonzero(~np.isfinite(image))} pixels that are not",
            "Fill them and leave them out of `usable`.",
        )
    varying = detail.high_passed(image)
    energy = detail.variance(varying)
    floor = _FAINTEST * float(np.abs(image).max(initial=0.0)) + np.finfo(np.float32).tiny
    return np.asarray(varying / np.sqrt(energy + np.float32(floor) ** 2 + 1e-30), np.float32)


def local_ncc(first: NDArray, second: NDArray, usable: NDArray[np.bool_]) -> Array:
    """Normalised cross-correlation of two images in windows of 31 x 31 px every 16 px.

    The windows are those whose pixels are all usable: pass pixels away from depth edges
    (`starling.sim.metrics.depth_edges`), inside both images. In each the means are subtracted, so any
    gain and offset drop out. A window in which either image is constant scores 0.

    Args:
        first: (h, w), usually `high_passed`.
        second: (h, w), likewise.
        usable: (h, w) mask; what it leaves out may hold any value, NaN included.

    Returns:
        (n,) in [-1, 1], row by row; n = 0 where no window is usable.

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
    one = np.where(usable, first, 0).astype(np.float64)
    other = np.where(usable, second, 0).astype(np.float64)
    whole = _means(usable.astype(np.float64)) > 1 - 0.5 / WINDOW_PX**2
    mean_one, mean_other = _means(one)[whole], _means(other)[whole]
    square_one, square_other = _means(one * one)[whole], _means(other * other)[whole]
    variance_one, variance_other = square_one - mean_one**2, square_other - mean_other**2
    covariance = _means(one * other)[whole] - mean_one * mean_other
    # Variances this far below the mean square are rounding.
    varies = (variance_one > 1e-10 * square_one) & (variance_other > 1e-10 * square_other)
    product = np.where(varies, variance_one * variance_other, 1.0)
    return np.where(varies, np.clip(covariance / np.sqrt(product), -1, 1), 0).astype(np.float32)


def right_in_left(right: NDArray, disparity_px: NDArray) -> tuple[Array, NDArray[np.bool_]]:
    """Warp the right image into the left view by a disparity map (cubic interpolation).

    Args:
        right: (h, w).
        disparity_px: (h, w) x_left - x_right [px] of the left view, NaN where unknown.

    Returns:
        The image (h, w), and the mask (h, w) of pixels whose disparity is known and points into
        the right image; elsewhere the image repeats the right one's border.
    """
    height, width = disparity_px.shape
    known = np.isfinite(disparity_px)
    x = np.arange(width, dtype=np.float32) - np.where(known, disparity_px, 0)
    y = np.broadcast_to(np.arange(height, dtype=np.float32)[:, None], x.shape)
    # Beyond the border by millions of pixels, remap's own integers overflow.
    place = np.clip(x, -2 * width, 3 * width).astype(np.float32)
    warped = cv2.remap(
        np.asarray(right, np.float32),
        place,
        np.ascontiguousarray(y),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped, np.float32), known & (x >= 0) & (x <= width - 1)


def _means(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over every window that lies in the image, (rows, columns) of windows."""
    margin = WINDOW_PX // 2
    mean = cv2.boxFilter(image, cv2.CV_64F, (WINDOW_PX, WINDOW_PX))
    return np.asarray(mean, np.float64)[margin:-margin:STRIDE_PX, margin:-margin:STRIDE_PX]
