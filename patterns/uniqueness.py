"""How unique a pattern's windows are along the epipolar line."""

from __future__ import annotations

import numpy as np

from starling.patterns.errors import in_interval, positive, refuse
from starling.patterns.field import Field
from starling.patterns.whole import whole

BANDS = 48  # Rows of windows looked at, evenly spaced: a share to about 1 %.
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
    """Share of windows with no look-alike within the disparity search along their row.

    The image is brought to the camera's scale (`focal_px` pixels per unit tangent; a wall
    parallel to both keeps the row). A window is unique if its normalised cross-correlation with
    every window of the same row shifted right by s stays below `threshold`, for all s from
    window_px // 2 + 1 (nearer shifts belong to the match's own peak) to search_px. One side is
    enough: the other shows the same pairs. NCC is damped by a contrast floor, 5 % of the image's
    standard deviation, and a window below the floor counts as not unique: there is nothing to
    match. No noise, no imager blur: an upper bound of what a matcher can use. Windows so near
    the right edge that their search leaves the field are left out; 48 evenly spaced rows of
    windows are looked at, every column.

    Args:
        image: (h, w) irradiance.
        field: Field of view that the image spans.
        focal_px: Camera focal length [px]; None: the image's own.
        window_px: Side of the window [px], 3 to 31.
        search_px: Largest shift [px]; 126 is the D400 search range.
        threshold: NCC at which a window has a look-alike.

    Raises:
        InputError: if a parameter is out of range or the field is too narrow for the search.
    """
    window_px = whole("window_px", window_px, 3, 31, "Give the matcher's window side.")
    search_px = whole("search_px", search_px, window_px, 1024, "Give the disparity search range.")
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
        here, there = slice(0, count), slice(shift, shift + count)
        covariance = _boxes(product, window_px)[:, here] / area - mean[:, here] * mean[:, there]
        np.maximum(best, covariance / (scale[:, here] * scale[:, there]), out=best)
    unique = (best < threshold) & (variance[:, :count] > floor)
    return float(unique.mean())


def at_focal(image: np.ndarray, field: Field, focal_px: float | None) -> np.ndarray:
    """The image (h, w) at square pixels of the given focal length [px]; None: its own x focal.

    Raises:
        InputError: if focal_px is not above zero or makes an image over 8192 px wide.
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
    # Blur as the coarser grid's pixel would before taking fewer samples.
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
