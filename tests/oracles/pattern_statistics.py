"""Statistics of a pattern, from its dot list or from its image, and uniqueness of its windows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from starling.patterns.dots import SIGMA_PER_FWHM
from starling.patterns.errors import in_interval, positive, refuse, whole_number
from starling.patterns.field import Field, unit_vectors
from starling.patterns.pattern import Pattern, check_image

FURTHEST_MERGE = 1.75  # [2 sigma]. Beyond it, spots merge only at power ratios over 15.
FAINTEST = 0.05  # Least height of a spot, as a share of the bright spots' height.
BANDS = 48  # Evenly spaced rows of windows; they give the share to about 1 %.
BLANK = 0.05  # Contrast floor, relative to the whole image's standard deviation.


@dataclass(frozen=True, kw_only=True, slots=True)
class Statistics:
    """Statistics that the dot list and the image both give.

    Args:
        dots: Number of separate spots. Spots whose sum has one maximum count as one: equal spots
            closer than 2 sigma = 0.85 FWHM, unequal spots also at larger distances.
        dots_per_deg2: `dots` per square degree of the field's solid angle.
        neighbour_mrad: Median angle from a spot to its nearest neighbour [mrad].
        fwhm_mrad: Median spot width, full width at half maximum [mrad].
        dot_share: Share of the light in spots; the remainder is an even background.
        unique_share: Share of 11x11 windows unique along the row within 126 px at `focal_px`
            (see `unique_share`).
        focal_px: Camera focal length of `unique_share` [px].
    """

    dots: int
    dots_per_deg2: float
    neighbour_mrad: float
    fwhm_mrad: float
    dot_share: float
    unique_share: float
    focal_px: float


def stated_statistics(pattern: Pattern, *, focal_px: float | None = None) -> Statistics:
    """Compute the statistics of a generated pattern from its dot list and parameters.

    Only `unique_share` is measured on the image, because it has no closed form.

    Args:
        pattern: A pattern with dots.
        focal_px: Camera focal length [px] for the uniqueness; None: the pattern image's own.

    Raises:
        InputError: if the pattern carries no dots, or as `unique_share`.
    """
    if pattern.dots is None or pattern.fwhm_mrad is None or pattern.background is None:
        raise refuse("pattern", "must carry its dots", pattern.name, "Use measure on its image.")
    field = pattern.field
    rays = unit_vectors(*field.tangents(pattern.dots[:, 0], pattern.dots[:, 1], pattern.shape))
    rays = _merge(rays, pattern.dots[:, 2], SIGMA_PER_FWHM * pattern.fwhm_mrad * 1e-3)
    return Statistics(
        dots=len(rays),
        dots_per_deg2=len(rays) / field.solid_angle_deg2,
        neighbour_mrad=_neighbour_mrad(rays),
        fwhm_mrad=pattern.fwhm_mrad,
        dot_share=1 - pattern.background,
        unique_share=unique_share(pattern.image, field, focal_px=focal_px),
        focal_px=field.focal_px(pattern.shape)[0] if focal_px is None else focal_px,
    )


def measure(
    image: np.ndarray, *, fov_x_deg: float, fov_y_deg: float, focal_px: float | None = None
) -> Statistics:
    """Measure the statistics of a pattern on its image.

    The background is the image's first percentile, so spots must leave gaps. A spot is a local
    maximum of 3x3 pixels above 5 % of the bright spots' height (the 99.5th percentile). A
    parabola through the logarithm of these pixels gives position and width; it is exact for an
    isolated Gaussian. Smooth a noisy photograph first.

    Args:
        image: (h, w) linear irradiance of any scale.
        fov_x_deg: Full horizontal field of view [deg].
        fov_y_deg: Full vertical field of view [deg].
        focal_px: Camera focal length [px] for the uniqueness; None: the image's own.

    Raises:
        InputError: if the image is invalid (see `Pattern`) or holds no spot, or as `unique_share`.
    """
    field = Field(fov_x_deg, fov_y_deg)
    image = check_image(image).astype(np.float64)
    shape = image.shape[0], image.shape[1]
    background = float(np.percentile(image, 1))
    light = image - background
    x_px, y_px, area_px2 = _spots(light)
    if not len(x_px):
        raise refuse("image", "must hold a spot", "none", "Give a pattern of dots.")
    x, y = field.tangents(x_px, y_px, shape)
    focal_x, focal_y = field.focal_px(shape)
    # A plane element at tangent r covers (1 + r^2)^-2 of its area in direction cosines.
    area = area_px2 / (focal_x * focal_y) * (1 + x * x + y * y) ** -2
    return Statistics(
        dots=len(x),
        dots_per_deg2=len(x) / field.solid_angle_deg2,
        neighbour_mrad=_neighbour_mrad(unit_vectors(x, y)),
        fwhm_mrad=float(np.sqrt(np.nanmedian(area))) / SIGMA_PER_FWHM * 1e3,
        dot_share=1 - background / float(image.mean()),
        unique_share=unique_share(image, field, focal_px=focal_px),
        focal_px=focal_x if focal_px is None else focal_px,
    )


def _spots(light: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions x, y [px] and sigma_1 * sigma_2 [px^2] of spots; NaN where the fit fails."""

    peak = (light == ndimage.maximum_filter(light, 3)) & (
        light > FAINTEST * np.percentile(light, 99.5)
    )
    # A plateau (clipped or quantised) is one spot; its first pixel represents it.
    labels, count = ndimage.label(peak, structure=np.ones((3, 3)))
    flat = np.flatnonzero(peak)
    _, first = np.unique(labels.ravel()[flat], return_index=True)
    row, column = np.divmod(flat[first], light.shape[1])
    x, y = column.astype(float), row.astype(float)
    area = np.full(count, np.nan)
    inner = (row > 0) & (row < light.shape[0] - 1) & (column > 0) & (column < light.shape[1] - 1)
    offsets = np.arange(-1, 2)
    near = light[
        row[inner, None, None] + offsets[:, None], column[inner, None, None] + offsets[None]
    ]
    log = np.log(np.maximum(near, 1e-12))
    # Closed-form least squares of a parabola on 3x3 samples: slopes and curvatures.
    slope_x = (log[:, :, 2] - log[:, :, 0]).sum(1) / 6
    slope_y = (log[:, 2] - log[:, 0]).sum(1) / 6
    curve_x = (log[:, :, 0] - 2 * log[:, :, 1] + log[:, :, 2]).sum(1) / 3
    curve_y = (log[:, 0] - 2 * log[:, 1] + log[:, 2]).sum(1) / 3
    cross = (log[:, 2, 2] + log[:, 0, 0] - log[:, 0, 2] - log[:, 2, 0]) / 4
    determinant = curve_x * curve_y - cross**2
    fit = (curve_x < 0) & (curve_y < 0) & (determinant > 1e-12)
    chosen = np.flatnonzero(inner)[fit]
    step_x = (cross * slope_y - curve_y * slope_x)[fit] / determinant[fit]
    step_y = (cross * slope_x - curve_x * slope_y)[fit] / determinant[fit]
    x[chosen] += np.clip(step_x, -1, 1)
    y[chosen] += np.clip(step_y, -1, 1)
    area[chosen] = determinant[fit] ** -0.5
    return x, y, area


def _merge(rays: np.ndarray, power: np.ndarray, sigma: float) -> np.ndarray:
    """Merge spots whose pairwise sum has one maximum; return their unit vectors (m, 3).

    Two Gaussians of one width at distance 2 d sigma and power ratio q have two maxima only if
    `d > 1 and |ln q| < 2 d sqrt(d^2 - 1) + 2 ln(d - sqrt(d^2 - 1))`. Source: Behboodian,
    On the modes of a mixture of two normal distributions, Technometrics 12 (1970).
    """

    cosines = rays[:, :2]  # All spots have one width in direction cosines.
    pairs = KDTree(cosines).query_pairs(2 * FURTHEST_MERGE * sigma, output_type="ndarray")
    first, second = pairs[:, 0], pairs[:, 1]
    d = np.linalg.norm(cosines[first] - cosines[second], axis=1) / (2 * sigma)
    root = np.sqrt(np.maximum(d * d - 1, 0))
    room = 2 * d * root + 2 * np.log(np.where(d > 1, d - root, 1))
    weight = np.log(np.maximum(power, 1e-30))
    pairs = pairs[(d <= 1) | (np.abs(weight[first] - weight[second]) >= room)]
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rays),) * 2)
    count, label = connected_components(links, directed=False)
    joined = np.stack(
        [np.bincount(label, weights=rays[:, k] * power, minlength=count) for k in range(3)],
        axis=1,
    )
    return joined / np.linalg.norm(joined, axis=1, keepdims=True)


def _neighbour_mrad(rays: np.ndarray) -> float:
    """Median angle to the nearest neighbour [mrad]; NaN for a single ray."""

    if len(rays) < 2:
        return math.nan
    chord = KDTree(rays).query(rays, k=2)[0][:, 1]
    return float(np.median(2 * np.arcsin(chord / 2)) * 1e3)


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
        offset=offset,
        output_shape=shape,
        order=1,
        mode="nearest",
    )


def _boxes(rows: np.ndarray, window: int) -> np.ndarray:
    """Sums over every run of `window` columns: (n, w) to (n, w - window + 1)."""
    total = np.cumsum(rows, axis=1)
    total = np.pad(total, ((0, 0), (1, 0)))
    return total[:, window:] - total[:, :-window]
