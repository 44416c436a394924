"""Features of an image's sharpness and of its autocorrelation by direction."""

from __future__ import annotations

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Image, Strata

_SHIFTS = ((1, 0), (2, 0), (3, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, -1))  # (x, y) [px].


def texture_features(
    image: Image, strata: Strata, places: tuple[str, ...] = ("radius", "depth", "y")
) -> dict[str, float]:
    """Compute energies at the finest scales, by bin, and the autocorrelation of near pixels."""
    fine = np.asarray(image, np.float32)
    laplacian = cv2.Laplacian(fine, cv2.CV_32F) ** 2
    across = cv2.Sobel(fine, cv2.CV_32F, 1, 0) ** 2
    down = cv2.Sobel(fine, cv2.CV_32F, 0, 1) ** 2
    band = (cv2.GaussianBlur(fine, (0, 0), 1.0) - cv2.GaussianBlur(fine, (0, 0), 2.0)) ** 2
    features = {}
    for name in places:
        for bin_name, where in strata.crossed_bins(name, "dots"):
            sharp = bins.log(bins.mean(laplacian, where))
            features[f"texture.laplacian.{bin_name}"] = sharp
            coarse = bins.log(bins.mean(band, where))
            features[f"texture.slope.{bin_name}"] = sharp - coarse
            features[f"texture.direction.{bin_name}"] = bins.log(
                bins.mean(across, where)
            ) - bins.log(bins.mean(down, where))
    high = fine - bins.smooth(fine, 9)
    for bin_name, where in strata.bins("dots"):
        power = bins.mean(high**2, where)
        for dx, dy in _SHIFTS:
            product = high * np.roll(high, (-dy, -dx), axis=(0, 1))
            name = f"texture.alike {dx},{dy}.{bin_name}"
            features[name] = bins.mean(product, where) / max(power, 1e-9)
    return features
