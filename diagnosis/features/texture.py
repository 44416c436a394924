"""How sharp an image is, and along which direction its pixels are alike."""

from __future__ import annotations

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground, Image

_SHIFTS = ((1, 0), (2, 0), (3, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, -1))  # (x, y) [px].


def texture(
    image: Image, ground: Ground, places: tuple[str, ...] = ("radius", "depth", "y")
) -> dict[str, float]:
    """Energies at the finest scales by place and depth, and correlations of near pixels."""
    fine = np.asarray(image, np.float32)
    laplacian = cv2.Laplacian(fine, cv2.CV_32F) ** 2
    across = cv2.Sobel(fine, cv2.CV_32F, 1, 0) ** 2
    down = cv2.Sobel(fine, cv2.CV_32F, 0, 1) ** 2
    band = (cv2.GaussianBlur(fine, (0, 0), 1.0) - cv2.GaussianBlur(fine, (0, 0), 2.0)) ** 2
    found = {}
    for name in places:
        for where_name, where in ground.crossed(name, "dots"):
            sharp = bins.log(bins.mean(laplacian, where))
            found[f"texture.laplacian.{where_name}"] = sharp
            coarse = bins.log(bins.mean(band, where))
            found[f"texture.slope.{where_name}"] = sharp - coarse
            found[f"texture.direction.{where_name}"] = bins.log(
                bins.mean(across, where)
            ) - bins.log(bins.mean(down, where))
    high = fine - bins.smooth(fine, 9)
    for word, where in ground.each("dots"):
        power = bins.mean(high**2, where)
        for dx, dy in _SHIFTS:
            beside = high * np.roll(high, (-dy, -dx), axis=(0, 1))
            found[f"texture.alike {dx},{dy}.{word}"] = bins.mean(beside, where) / max(power, 1e-9)
    return found
