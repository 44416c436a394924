"""What age and a poor lens make of a pattern: dots that are dark, displaced or wider."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from starling.patterns.cosine_blur import blurred
from starling.patterns.dots import SIGMA_PER_FWHM, draw
from starling.patterns.errors import in_interval, refuse
from starling.patterns.field import Field
from starling.patterns.pattern import Pattern

_FINE_PX = 8.0  # Full width of a spot above which a coarser drawing holds it as well.


def irradiance(
    pattern: Pattern,
    *,
    dropped: float = 0.0,
    shifted_mrad: float = 0.0,
    widened_mrad: float = 0.0,
    rng: np.random.Generator,
) -> np.ndarray:
    """Relative irradiance of a pattern with faults, the intact one's mean being 1.

    Dark dots take their light with them, and what is thrown out of the field is lost: nothing
    gets brighter. The light that is not in dots stays as it is. Widths add in quadrature: dots
    are drawn anew; an image without dots is blurred (see `starling.patterns.cosine_blur`).

    Args:
        pattern: the intact one.
        dropped: share of the dots that are dark, in [0, 0.99]; more darkens the same ones first.
        shifted_mrad: standard deviation of a dot's displacement on each axis [mrad].
        widened_mrad: standard deviation of the Gaussian that the spots are convolved with [mrad].
        rng: which dots, and where to; equal states give equal dots whatever the other faults.

    Returns:
        (h, w) float32; the pattern's own image where there are no faults.

    Raises:
        InputError: if a value is out of range, spots get wider than a quarter of the image, or
            dots are to be dropped or shifted of which nobody knows where they are.
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
        return blurred(pattern.image, pattern.field, widened_mrad)
    lot, step = rng.random(len(dots)), rng.standard_normal((2, len(dots)))
    dots = dots.copy()
    dots[lot < dropped, 2] = 0  # They stay in the list: the others' sums keep their order.
    if shifted_mrad:
        _displace(dots, step * (shifted_mrad * 1e-3), pattern)
    wide = float(np.hypot(fwhm_mrad, widened_mrad / SIGMA_PER_FWHM))
    light = _drawn(dots, pattern.shape, pattern.field, wide)
    return (background + (1 - background) * light / _mean(pattern)).astype(np.float32)


@lru_cache(maxsize=4)
def _mean(pattern: Pattern) -> float:
    """Mean power a pixel of the intact pattern's dots."""
    assert pattern.dots is not None and pattern.fwhm_mrad is not None
    return draw(pattern.dots, pattern.shape, pattern.field, pattern.fwhm_mrad).mean()


def _displace(dots: np.ndarray, step: np.ndarray, pattern: Pattern) -> None:
    """Move dots in place by angles `step` (2, n) [rad] on two axes across each ray."""
    x, y = pattern.field.tangents(dots[:, 0], dots[:, 1], pattern.shape)
    ray = np.stack([x, y, np.ones_like(x)], axis=1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    down = np.cross(ray, [1.0, 0.0, 0.0])  # No field reaches the x axis.
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    right = np.cross(down, ray)
    ray = ray + np.tan(step[0])[:, None] * right + np.tan(step[1])[:, None] * down
    depth = np.maximum(ray[:, 2], 1e-3)  # Beyond the horizon is far outside of every field.
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
