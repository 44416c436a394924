"""Uniqueness of a pattern's windows along the epipolar line."""

from __future__ import annotations

import numpy as np

from starling.patterns.errors import in_interval, positive, refuse, whole_number
from starling.patterns.field import Field

BANDS = 48  # Evenly spaced rows of windows; they give the share to about 1 %.
BLANK = 0.05  # Contrast floor, relative to the whole image's standard deviation.


def unique_share(
    image: np.ndarray,
    field: Field,
    *,
    focal_px: float | None = None,
    window_px: int = 11,
    search_px: int = 126,
    threshold: float = 0.8,
) -> float:
    """Share of windows without a similar window in the disparity search along their row.

    The image is resampled to the camera's scale (`focal_px` pixels per unit tangent). A window is
    unique if its normalised cross-correlation (NCC) with all windows of its row, shifted right
    by s, stays below `threshold`. The shift s runs from window_px // 2 + 1 to search_px; smaller
    shifts belong to the peak of the correct match. Left shifts would repeat the same pairs.

    The NCC is damped by a contrast floor of 5 % of the image's standard deviation. A window below
    the floor counts as not unique. Noise and imager blur are ignored, so the share is an upper
    bound for a matcher. Windows whose search leaves the field on the right are excluded. 48
    evenly spaced rows of windows are evaluated, at all columns.

    Args:
        image: (h, w) irradiance.
        field: Field of view that the image spans.
        focal_px: Camera focal length [px]; None: the image's own.
        window_px: Side of the window [px], 3 to 31.
        search_px: Largest shift [px]; 126 is the D400 search range.
        threshold: NCC from which two windows count as similar.

    Raises:
        InputError: if a parameter is out of range or the field is too narrow for the search.
    """
    window_px = whole_number("window_px", window_px, 3, 31, "Give the matcher's window side.")
    search_px = whole_number(
        "search_px", search_px, window_px, 1024, "Give the disparity search range."
    )
    in_interval("threshold", threshold, 0.0, 1.0)
    scaled = at_focal(image, field, focal_px).astype(np.float64)
    height, width = scaled.shape
    if width < search_px + 2 * window_px or height < window_px:
        raise refuse(
            "image",
            f"must be at least {search_px + 2 * window_px} px wide at the camera's scale",
            f"{width}x{height}",
            "Lower search_px or raise focal_px or the field.",
        )
    scaled -= scaled.mean()
    tops = np.unique(np.linspace(0, height - window_px, BANDS).astype(int))
    bands = np.stack([scaled[top : top + window_px] for top in tops])  # (n, window, width)
    area = window_px**2
    floor = BLANK**2 * scaled.var()
    mean = _boxes(bands.sum(axis=1), window_px) / area
    variance = np.maximum(_boxes((bands**2).sum(axis=1), window_px) / area - mean**2, 0)
    scale = np.sqrt(variance + floor)
    count = mean.shape[1] - search_px
    best = np.full((len(tops), count), -np.inf)
    for shift in range(window_px // 2 + 1, search_px + 1):
        product = np.einsum("nkw,nkw->nw", bands[..., :-shift], bands[..., shift:])
        base, shifted = slice(0, count), slice(shift, shift + count)
        covariance = _boxes(product, window_px)[:, base] / area - mean[:, base] * mean[:, shifted]
        np.maximum(best, covariance / (scale[:, base] * scale[:, shifted]), out=best)
    unique = (best < threshold) & (variance[:, :count] > floor)
    return float(unique.mean())


def at_focal(image: np.ndarray, field: Field, focal_px: float | None) -> np.ndarray:
    """Resample the image (h, w) to square pixels of a focal length [px]; None: its own fx.

    Raises:
        InputError: if focal_px is not above zero, or gives an image over 8192 px wide.
    """
    from scipy import ndimage  # Heavy, like all of scipy: not at import.

    focal_x, focal_y = field.focal_px((image.shape[0], image.shape[1]))
    if focal_px is None:
        focal_px = focal_x
    positive("focal_px", focal_px, "Give the camera's focal length in pixels.")
    shape = round(focal_px * 2 * field.half_y), round(focal_px * 2 * field.half_x)
    in_interval("focal_px", focal_px, 16.0, 8192 / (2 * field.half_x), "Give a camera's focal.")
    if shape == image.shape:
        return image
    step = np.array([focal_y, focal_x]) / focal_px
    # Anti-aliasing: blur by the coarser grid's pixel before downsampling.
    smooth = ndimage.gaussian_filter(image, np.maximum(0.0, (step - 1) / 2))
    offset = (np.array(image.shape) - 1) / 2 - step * (np.array(shape) - 1) / 2
    return ndimage.affine_transform(
        smooth,
        step,
        offset=offset,  # pyright: ignore[reportArgumentType] -- an array works, the stub says float.
        output_shape=shape,
        order=1,
        mode="nearest",
    )


def _boxes(rows: np.ndarray, window: int) -> np.ndarray:
    """Sums over every run of `window` columns: (n, w) to (n, w - window + 1)."""
    total = np.cumsum(rows, axis=1)
    total = np.pad(total, ((0, 0), (1, 0)))
    return total[:, window:] - total[:, :-window]
