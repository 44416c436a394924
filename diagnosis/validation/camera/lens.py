"""Effects of the lens: blur, vignetting and veiling glare."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import brentq

from starling.diagnosis.validation.camera import psf, spread
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import Image, LightView
from starling.diagnosis.validation.camera.nominal import Nominal

_FARTHEST_APART = 8.0  # Upper bound of the stops' shift at the image corner [radii].
_VEIL_WIDTH = 0.75  # Sigma of the scattered light over the longer side of the image.


def focus(light_e: Image, view: LightView, strengths: Strengths) -> Image:
    """Blur light (h, w) by the spot of the lens.

    The nominal lens has a Gaussian spot. Added variance has the shape of a disc, the spot of a
    defocused round aperture. Removed variance narrows the Gaussian.
    """
    nominal_px = strengths.nominal.lens_blur_px
    narrow_px = min(nominal_px, strengths.value("lens_blur"))
    sharp = psf.blur(light_e, psf.kernel("gaussian", narrow_px))
    return spread.scatter(sharp, added_blur_px(view, strengths), "disc")


def added_blur_px(view: LightView, strengths: Strengths) -> NDArray[np.float64]:
    """Return the standard deviation (h, w) [px] that lens blur, corner blur and defocus add.

    Each source pixel spreads its light, so the blur of a near body extends over a far one behind
    it (Potmesil and Chakravarty 1982, eqs. 1 to 5).
    """
    nominal = strengths.nominal
    even = max(strengths.value("lens_blur") ** 2 - nominal.lens_blur_px**2, 0.0)
    corner = (strengths.value("corner_blur") * nominal.radius()) ** 2
    inverse_m = np.nan_to_num(1.0 / view.depth_m)  # Missing depth counts as infinitely far.
    near = (strengths.value("near_defocus") * (inverse_m - 1.0 / nominal.lens_focus_m)) ** 2
    return np.sqrt(even + corner + near)


def vignetting(nominal: Nominal, exponent: float) -> NDArray[np.float64]:
    """Return the relative illumination (h, w) of a lens off its axis.

    Two equal round stops replace cos^n of the effect page. Off the axis one stop covers part of the
    other, so the light is the overlap of two circles (Smith, Modern Optical Engineering, ch. 6).
    Their shift is proportional to the tangent. Its scale makes the given exponent the least-squares
    fit among all cos^n.
    """
    across, down = nominal.tangents()
    tangent = np.hypot(across, down)
    law = (1.0 + tangent**2) ** (-0.5 * exponent)
    slope = law * np.log1p(tangent**2)  # Derivative of the law with respect to n, up to a factor.

    def excess(shift: float) -> float:
        """Derivative of the squared residual with respect to n, 0 at the best fit."""
        return float(np.vdot(law - _overlap(shift * tangent), slope))

    shift = brentq(excess, 0.0, _FARTHEST_APART / float(tangent.max()))
    assert isinstance(shift, float)
    return _overlap(shift * tangent)


def veil(laser_e: Image, rest_e: Image, share: float) -> tuple[Image, Image]:
    """Scatter a share of all light over the image (veiling glare).

    The effect page spreads the share uniformly. Here a very wide Gaussian spreads it nearly
    uniformly. Mirrored borders preserve the mean.

    Returns:
        The remaining laser light, and all other light including the veiling glare (h, w).
    """
    if share == 0.0:
        return laser_e, rest_e
    sigma = _VEIL_WIDTH * max(laser_e.shape)
    waves = np.asarray(fft.dctn(laser_e + rest_e))  # The cosine transform mirrors the border.
    down, across = (np.pi * np.arange(n) / n for n in laser_e.shape)
    waves *= np.exp(-0.5 * sigma**2 * (down[:, None] ** 2 + across[None, :] ** 2))
    glare = np.asarray(fft.idctn(waves))
    return (1.0 - share) * laser_e, (1.0 - share) * rest_e + share * glare


def _overlap(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Overlap of two unit circles at a distance of their centres, over the area of one circle."""
    half = np.clip(0.5 * distance, 0.0, 1.0)
    return (2.0 / math.pi) * (np.arccos(half) - half * np.sqrt(1.0 - half**2))
