"""Faults of a pattern: dark, displaced and widened dots."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from starling.patterns.dots import SIGMA_PER_FWHM, draw
from starling.patterns.errors import in_interval, refuse
from starling.patterns.field import Field
from starling.patterns.pattern import Pattern

_FINER = 3  # Map pixels per image pixel, along each axis.
# Mean variance that the two linear interpolations add [map pixel^2].
_INTERPOLATED_PX2 = (1 + _FINER**-2) / 6

_FINE_PX = 8.0  # Spots wider than this [px FWHM] are drawn on a coarser image.


def blur_in_cosines(image: np.ndarray, field: Field, sigma_mrad: float) -> np.ndarray:
    """Convolve a pattern's light with a Gaussian of one width in direction cosines.

    All orders of a diffractive element have one beam width in direction cosines. On the plane
    that width depends on the position. The light is therefore resampled over direction cosines,
    blurred there, and resampled back.

    Args:
        image: (h, w) irradiance on the plane.
        field: Field of view of the image. Light blurred out of the field is lost.
        sigma_mrad: Standard deviation of the Gaussian on the axis [mrad], > 0. A width below one
            pixel is a mixture of the image and the image blurred by one pixel.

    Returns:
        (h, w) float32, in the units of `image`.
    """
    import cv2  # Heavy, and needed here only.

    shape = image.shape[0], image.shape[1]
    focal_x, focal_y = field.focal_px(shape)
    least_mrad = 1e3 / min(focal_x, focal_y)
    if sigma_mrad < least_mrad:
        share = (sigma_mrad / least_mrad) ** 2
        mixed = (1 - share) * image + share * blur_in_cosines(image, field, least_mrad)
        return mixed.astype(np.float32)
    fine_x, fine_y = _FINER * focal_x, _FINER * focal_y
    columns = int(np.ceil(2 * np.sin(np.arctan(field.half_x)) * fine_x)) + 2
    rows = int(np.ceil(2 * np.sin(np.arctan(field.half_y)) * fine_y)) + 2
    # Image position of each map pixel.
    map_x = (np.arange(columns) - (columns - 1) / 2)[None, :] / fine_x
    map_y = (np.arange(rows) - (rows - 1) / 2)[:, None] / fine_y
    stretch = 1 / np.sqrt(np.maximum(1 - map_x**2 - map_y**2, 1e-6))
    from_plane = field.pixels(map_x * stretch, map_y * stretch, shape)
    # Map position of each image pixel.
    x, y = field.tangents(np.arange(shape[1])[None, :], np.arange(shape[0])[:, None], shape)
    secant = np.sqrt(1 + x**2 + y**2)
    from_map = x / secant * fine_x + (columns - 1) / 2, y / secant * fine_y + (rows - 1) / 2

    def resample(light: np.ndarray, position: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        x_px, y_px = (np.ascontiguousarray(axis, np.float32) for axis in position)
        return cv2.remap(light, x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)

    # A plane element covers sec^-4 of its area in direction cosines.
    intensity = resample((image * secant**4).astype(np.float32), from_plane)
    sigma_x, sigma_y = (
        _FINER * float(np.sqrt((sigma_mrad * 1e-3 * focal) ** 2 - _INTERPOLATED_PX2))
        for focal in (focal_x, focal_y)
    )
    intensity = cv2.GaussianBlur(
        intensity, (0, 0), sigma_x, sigmaY=sigma_y, borderType=cv2.BORDER_CONSTANT
    )
    return (resample(intensity, from_map) / secant**4).astype(np.float32)


def irradiance(
    pattern: Pattern,
    *,
    dropped: float = 0.0,
    shifted_mrad: float = 0.0,
    widened_mrad: float = 0.0,
    rng: np.random.Generator,
) -> np.ndarray:
    """Compute the relative irradiance of a pattern with faults; the intact pattern has mean 1.

    The light of dark dots, and light displaced out of the field, is lost. The background between
    dots is unchanged. Widths add in quadrature. A pattern with a dot list is redrawn; a pattern
    without one is blurred (see `starling.patterns.faults`).

    Args:
        pattern: Intact pattern.
        dropped: Share of dark dots, in [0, 0.99]. A larger share contains the smaller one's dots.
        shifted_mrad: Standard deviation of a dot's displacement on each axis [mrad].
        widened_mrad: Standard deviation of the Gaussian that spots are convolved with [mrad].
        rng: Selects the dark dots and the displacements. Equal generator states give equal
            selections for all values of the faults.

    Returns:
        (h, w) float32; the pattern's own image if there are no faults.

    Raises:
        InputError: if a value is out of range, or spots become wider than a quarter of the image.
            Also if dots are dropped or shifted in a pattern without a dot list.
    """
    in_interval("dropped", dropped, 0.0, 0.99, "Give the share of dark dots.")
    in_interval("shifted_mrad", shifted_mrad, 0.0, 100.0, "Give a standard deviation in mrad.")
    in_interval("widened_mrad", widened_mrad, 0.0, 100.0, "Give a standard deviation in mrad.")
    if not (dropped or shifted_mrad or widened_mrad):
        return pattern.image
    dots, fwhm_mrad, background = pattern.dots, pattern.fwhm_mrad, pattern.background
    if dots is None or fwhm_mrad is None or background is None:
        if dropped or shifted_mrad:
            raise refuse(
                "pattern",
                "must know its dots where some are dropped or shifted",
                pattern.name,
                "Take a generated pattern, or change the image itself.",
            )
        return blur_in_cosines(pattern.image, pattern.field, widened_mrad)
    rank, step = rng.random(len(dots)), rng.standard_normal((2, len(dots)))
    dots = dots.copy()
    dots[rank < dropped, 2] = 0  # Kept in the list, so that sums keep their order.
    if shifted_mrad:
        _displace(dots, step * (shifted_mrad * 1e-3), pattern)
    wide = float(np.hypot(fwhm_mrad, widened_mrad / SIGMA_PER_FWHM))
    light = _drawn(dots, pattern.shape, pattern.field, wide)
    return (background + (1 - background) * light / _mean(pattern)).astype(np.float32)


@lru_cache(maxsize=4)
def _mean(pattern: Pattern) -> float:
    """Mean power per pixel of the intact pattern's dots."""
    assert pattern.dots is not None and pattern.fwhm_mrad is not None
    return draw(pattern.dots, pattern.shape, pattern.field, pattern.fwhm_mrad).mean()


def _displace(dots: np.ndarray, step: np.ndarray, pattern: Pattern) -> None:
    """Move dots in place by angles `step` (2, n) [rad] about two axes across each ray."""
    x, y = pattern.field.tangents(dots[:, 0], dots[:, 1], pattern.shape)
    ray = np.stack([x, y, np.ones_like(x)], axis=1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    down = np.cross(ray, [1.0, 0.0, 0.0])  # No field reaches the x axis.
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    right = np.cross(down, ray)
    ray = ray + np.tan(step[0])[:, None] * right + np.tan(step[1])[:, None] * down
    depth = np.maximum(ray[:, 2], 1e-3)  # Rays beyond the horizon land far outside every field.
    dots[:, 0], dots[:, 1] = pattern.field.pixels(
        ray[:, 0] / depth, ray[:, 1] / depth, pattern.shape
    )


def _drawn(dots: np.ndarray, shape: tuple[int, int], field: Field, fwhm_mrad: float) -> np.ndarray:
    """Power per pixel (h, w); wide spots are drawn on a coarser image and interpolated."""
    fwhm_px = fwhm_mrad * 1e-3 * min(field.focal_px(shape))
    if fwhm_px > min(shape) / 4:
        raise refuse(
            "spot",
            "must be at most a quarter of the pattern wide",
            f"{fwhm_mrad:.3g} mrad",
            "Widen it less.",
        )
    shrink = int(fwhm_px // _FINE_PX)
    if shrink < 2:
        return draw(dots, shape, field, fwhm_mrad)
    import cv2  # Heavy, and needed here only.

    coarse = round(shape[0] / shrink), round(shape[1] / shrink)
    placed = dots.copy()
    placed[:, 0], placed[:, 1] = field.pixels(
        *field.tangents(dots[:, 0], dots[:, 1], shape), coarse
    )
    light = draw(placed, coarse, field, fwhm_mrad)
    light *= coarse[0] * coarse[1] / (shape[0] * shape[1])
    fine = cv2.resize(light, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return np.maximum(fine, 0)
