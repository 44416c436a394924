"""Gaussian blur of a pattern with one width in direction cosines."""

from __future__ import annotations

import numpy as np

from starling.patterns.field import Field

_FINER = 3  # Map pixels per image pixel, along each axis.
# Mean variance that the two linear interpolations add [map pixel^2].
_INTERPOLATED_PX2 = (1 + _FINER**-2) / 6


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
