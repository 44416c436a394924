"""What physics tells: the probability of no depth from repeated simulations."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Physics
from starling.patterns import errors

# Where on its window a matcher's answer turns is a matter of single dots, and of the reference's
# registration to a pixel or two: a hole is told to half a window of 9 px. On real rooms the
# ranking of pixels gains from every blur of 1 to 8 px, most from 3 to 5.
PLACE_PX = 4.0
PRIOR_DRAWS = 1.0  # What the scene's own share of holes counts for.
_RAREST = 1e-3  # Least share of holes, or of depth, that a scene is taken to have.


def physics_probability(physics: Physics, *, place_px: float = PLACE_PX) -> Image:
    """Probability (h, w) of no depth that repeated simulations tell (see `drawn_probability`).

    Args:
        physics: repeated simulations.
        place_px: sigma of the Gaussian; 0 = as drawn.

    Raises:
        InputError: if there is no draw.
    """
    return drawn_probability(physics.ndp, physics.draws, place_px=place_px)


def drawn_probability(ndp: NDArray, draws: int, *, place_px: float = PLACE_PX) -> Image:
    """Probability (h, w) of no depth from k of n draws: (k' + a m) / (n + a), a = 1 draw.

    k' is k smoothed by a Gaussian: holes are told no more precisely than a matching window.
    Never 0 or 1: so few draws cannot be that sure. m is the share of holes in all draws of the
    scene, which the simulation itself knows: most pixels have depth, and half a draw's worth of
    doubt in each would tell 6 % of holes where there are none.

    Args:
        ndp: (h, w) k / n, share of the draws without depth, 0 to 1.
        draws: n.
        place_px: sigma of the Gaussian; 0 = as drawn.

    Source: the posterior mean under a beta prior fitted to all pixels (empirical Bayes; Casella, An
    introduction to empirical Bayes data analysis, The American Statistician 39, 1985).

    Raises:
        InputError: if there is no draw.
    """
    errors.in_interval("draws", draws, 1, 1_000_000, "Simulate at least once.")
    mean = np.clip(ndp.mean(dtype=np.float64), _RAREST, 1 - _RAREST)
    share = ndp.astype(np.float64)
    if place_px > 0:
        share = np.clip(_smoothed(share, place_px), 0, 1)
    return ((share * draws + PRIOR_DRAWS * mean) / (draws + PRIOR_DRAWS)).astype(np.float32)


def as_precise_as_physics(image: NDArray) -> NDArray:
    """Smooth an image (h, w) that physics has made by the doubt about its places, 4 px."""
    return _smoothed(image, PLACE_PX)


def _smoothed(image: NDArray, sigma_px: float) -> NDArray:
    smoothed = cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smoothed, image.dtype)
