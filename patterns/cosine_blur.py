"""Blur that is even in direction cosines, of a pattern given on the plane."""

from __future__ import annotations

import numpy as np

from starling.patterns.field import Field

_FINER = 3  # Pixels of the map in one of the image, along each axis.
# Variance that linear interpolation adds on average on the way there and back, of pixels.
_INTERPOLATED_PX2 = (1 + _FINER**-2) / 6


def blurred(image: np.ndarray, field: Field, sigma_mrad: float) -> np.ndarray:
    """Convolve a pattern's light with a Gaussian of one width in direction cosines.

    On the plane such a spot would change its size and shape from place to place. So the light is
    laid out over direction cosines, in which it is the same everywhere, as a beam's own width is
    in all orders of a diffractive element.

    Args:
        image: (h, w) irradiance on the plane.
        field: that the image spans; nothing is lit outside, and what goes there is lost.
        sigma_mrad: standard deviation of the Gaussian on the axis [mrad], > 0. Below a pixel the
            image and one blurred by a pixel are mixed to the variance asked for.

    Returns:
        (h, w) float32 of the same scale.
    """
    import cv2  # Heavy, and needed here only.

    shape = image.shape[0], image.shape[1]
    focal_x, focal_y = field.focal_px(shape)
    least_mrad = 1e3 / min(focal_x, focal_y)
    if sigma_mrad < least_mrad:
        share = (sigma_mrad / least_mrad) ** 2
        mixed = (1 - share) * image + share * blurred(image, field, least_mrad)
        return mixed.astype(np.float32)
    fine_x, fine_y = _FINER * focal_x, _FINER * focal_y
    columns = int(np.ceil(2 * np.sin(np.arctan(field.half_x)) * fine_x)) + 2
    rows = int(np.ceil(2 * np.sin(np.arctan(field.half_y)) * fine_y)) + 2
    # From every pixel of the map to the plane.
    map_x = (np.arange(columns) - (columns - 1) / 2)[None, :] / fine_x
    map_y = (np.arange(rows) - (rows - 1) / 2)[:, None] / fine_y
    stretch = 1 / np.sqrt(np.maximum(1 - map_x**2 - map_y**2, 1e-6))
    from_plane = field.pixels(map_x * stretch, map_y * stretch, shape)
    # And back.
    x, y = field.tangents(np.arange(shape[1])[None, :], np.arange(shape[0])[:, None], shape)
    secant = np.sqrt(1 + x**2 + y**2)
    from_map = x / secant * fine_x + (columns - 1) / 2, y / secant * fine_y + (rows - 1) / 2

    def laid_out(light: np.ndarray, place: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        at_x, at_y = (np.ascontiguousarray(axis, np.float32) for axis in place)
        return cv2.remap(light, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)

    # An element of the plane has sec^-4 of its area in cosines.
    intensity = laid_out((image * secant**4).astype(np.float32), from_plane)
    sigma_x, sigma_y = (
        _FINER * float(np.sqrt((sigma_mrad * 1e-3 * focal) ** 2 - _INTERPOLATED_PX2))
        for focal in (focal_x, focal_y)
    )
    intensity = cv2.GaussianBlur(
        intensity, (0, 0), sigma_x, sigmaY=sigma_y, borderType=cv2.BORDER_CONSTANT
    )
    return (laid_out(intensity, from_map) / secant**4).astype(np.float32)
