"""Drawing of dots as Gaussian spots at sub-pixel positions; each spot keeps its power."""

from __future__ import annotations

import math

import numpy as np

from starling.patterns.errors import in_interval, numbers, positive, refuse
from starling.patterns.field import Field

SIGMA_PER_FWHM = 1 / math.sqrt(8 * math.log(2))
NARROWEST_PX = 1.5  # Below it a sampled Gaussian's sum depends on the sub-pixel position.
STENCIL_SIGMAS = 4.0
MOST_DOTS = 200_000  # Six times a Kinect; a larger number is a mistyped parameter.
CHUNK = 1 << 17  # Stencil samples per batch, so that a batch stays in the cache.


def draw(dots: np.ndarray, shape: tuple[int, int], field: Field, fwhm_mrad: float) -> np.ndarray:
    """Draw dots as Gaussian spots on the tangent plane.

    All spots have one width in direction cosines, as the orders of a diffractive element have.
    On the plane a spot grows by 1/cos^3 of the off-axis angle radially, by 1/cos tangentially.
    The samples of a spot sum to its power. Light outside the image is lost.

    Args:
        dots: (n, 3) x [px], y [px], relative power >= 0; integer coordinate = pixel centre. Dots
            more than one image size outside are left out.
        shape: Image shape (h, w).
        field: Field of view that the image spans.
        fwhm_mrad: Full width at half maximum of a spot on the axis [mrad].

    Returns:
        (h, w) float64, power per pixel.

    Raises:
        InputError: if `dots` is invalid (see `check_dots`), or if the spot is narrower than 1.5 px
            or wider than a quarter of the image.
    """
    dots = check_dots(dots)
    check_width(fwhm_mrad, shape, field)
    focal_x, focal_y = field.focal_px(shape)
    # At grazing angles the projection of a spot is no longer Gaussian: such dots are dropped.
    off_x, off_y = (
        np.abs(dots[:, axis] - (side - 1) / 2) - side / 2
        for axis, side in ((0, shape[1]), (1, shape[0]))
    )
    near = (off_x < shape[1]) & (off_y < shape[0])
    dots, off_x, off_y = dots[near], off_x[near], off_y[near]
    x, y = field.tangents(dots[:, 0], dots[:, 1], shape)
    # Tangents t of cosines s change by (1 + t t') sqrt(1 + t't) ds.
    square = x * x + y * y
    stretch = (1 + square) * (SIGMA_PER_FWHM * fwhm_mrad * 1e-3) ** 2
    outwards = 2 + square
    variance_x = stretch * (1 + outwards * x * x) * focal_x**2
    variance_y = stretch * (1 + outwards * y * y) * focal_y**2
    covariance = stretch * outwards * x * y * focal_x * focal_y
    determinant = variance_x * variance_y - covariance**2
    # Rows: x, y, power, inverse covariance (xx, yy, xy).
    spots = np.stack(
        [
            dots[:, 0],
            dots[:, 1],
            dots[:, 2],
            variance_y / determinant,
            variance_x / determinant,
            -covariance / determinant,
        ]
    )
    radius_x = np.ceil(STENCIL_SIGMAS * np.sqrt(variance_x)).astype(int)
    radius_y = np.ceil(STENCIL_SIGMAS * np.sqrt(variance_y)).astype(int)
    reaching = (off_x < radius_x) & (off_y < radius_y)
    spots, radius_x, radius_y = spots[:, reaching], radius_x[reaching], radius_y[reaching]
    image = np.zeros(shape[0] * shape[1])
    # One stencil size per group keeps every group a plain array.
    for rx, ry in np.unique(np.stack([radius_x, radius_y], axis=1), axis=0):
        group = spots[:, (radius_x == rx) & (radius_y == ry)]
        step = max(1, CHUNK // int((2 * rx + 1) * (2 * ry + 1)))
        for start in range(0, group.shape[1], step):
            _splat(image, group[:, start : start + step], int(rx), int(ry), shape)
    return image.reshape(shape)


def _splat(image: np.ndarray, spots: np.ndarray, rx: int, ry: int, shape: tuple[int, int]) -> None:
    """Add spots (6, n) to the flat image in place, each on a (2 ry + 1, 2 rx + 1) stencil."""
    height, width = shape
    x, y, power, inverse_xx, inverse_yy, inverse_xy = spots[:, :, None, None]
    column = np.rint(x).astype(np.int64) + np.arange(-rx, rx + 1)[None, None, :]
    row = np.rint(y).astype(np.int64) + np.arange(-ry, ry + 1)[None, :, None]
    dx, dy = (column - x).astype(np.float32), (row - y).astype(np.float32)
    # This form needs one product and one sum fewer than the plain quadratic form.
    half_xx, half_yy, half_xy = (
        (-0.5 * inverse).astype(np.float32) for inverse in (inverse_xx, inverse_yy, inverse_xy)
    )
    spot = half_xx * dx + 2 * half_xy * dy
    spot *= dx
    spot += half_yy * dy**2
    np.exp(spot, out=spot)
    spot *= (power / spot.sum(axis=(1, 2), keepdims=True)).astype(np.float32)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    index = row * width + column
    if not inside.all():
        index, spot = index[inside], spot[inside]
    np.add.at(image, index.ravel(), spot.ravel().astype(np.float64))


def check_dots(dots: np.ndarray) -> np.ndarray:
    """Check a list of dots and return it as float64.

    Raises:
        InputError: if the shape is not (n, 3), or a row is not finite or has negative power.
    """
    dots = numbers("dots", dots).astype(np.float64)
    if dots.ndim != 2 or dots.shape[1] != 3:
        raise refuse("dots", "must have shape (n, 3)", dots.shape, "Give x_px, y_px, power.")
    bad = ~np.isfinite(dots).all(axis=1) | (dots[:, 2] < 0)
    if bad.any():
        value = f"{bad.sum()} others, first at row {bad.argmax()}"
        raise refuse("dots", "must be finite with power >= 0", value, "Drop or correct these rows.")
    return dots


def check_width(fwhm_mrad: float, shape: tuple[int, int], field: Field) -> None:
    """Refuse a spot width that an image of this shape cannot hold.

    Raises:
        InputError: if it is not positive, under 1.5 px or over a quarter of the shorter side.
    """
    positive("fwhm_mrad", fwhm_mrad, "Give the spot's full width at half maximum in mrad.")
    fwhm_px = fwhm_mrad * 1e-3 * min(field.focal_px(shape))
    if not NARROWEST_PX <= fwhm_px <= min(shape) / 4:
        raise refuse(
            "fwhm_mrad",
            f"must span {NARROWEST_PX:g} px to a quarter of the image",
            f"{fwhm_mrad:g} mrad = {fwhm_px:.2f} px",
            "Change fwhm_mrad or width_px.",
        )


def check_count(n: int, remedy: str) -> None:
    """Refuse a number of dots that is zero or would fill the memory.

    Raises:
        InputError: if it is outside 1 to 200 000.
    """
    if not 1 <= n <= MOST_DOTS:
        raise refuse("number of dots", f"must be in [1, {MOST_DOTS}]", n, remedy)


def relative_powers(n: int, spread: float, rng: np.random.Generator) -> np.ndarray:
    """Draw log-normal powers (n,) of mean about 1 and standard deviation / mean = `spread`.

    The distribution is assumed: powers are positive, and their causes (emitter, diffraction
    order) multiply.

    Raises:
        InputError: if `spread` is outside [0, 2].
    """
    in_interval("power_spread", spread, 0.0, 2.0, "Give standard deviation / mean of dot powers.")
    variance = math.log1p(spread**2)
    return np.exp(rng.standard_normal(n) * math.sqrt(variance) - variance / 2)
