"""What a lens does to light before pixels count it: spots, dim corners, veil."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import brentq

from starling.diagnosis.validation.camera import psf, spread
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import Image, View
from starling.diagnosis.validation.camera.nominal import Nominal

_FARTHEST_APART = 8.0  # Of the stops at the corner, in radii: next to no light is left.
_VEIL_WIDTH = 0.75  # Deviation of the scattered light's spread, over the image's longer side.


def focus(light_e: Image, view: View, strengths: Strengths) -> Image:
    """Blur light (h, w) by the lens's spot.

    The nominal lens has a Gaussian spot. What an effect adds to its variance comes as a disc, the
    spot of a defocused round aperture; what it takes away narrows the Gaussian.
    """
    nominal_px = strengths.nominal.lens_blur_px
    narrow_px = min(nominal_px, strengths.of("lens_blur"))
    sharp = psf.blur(light_e, psf.kernel("gaussian", narrow_px))
    return spread.scatter(sharp, added_blur_px(view, strengths), "disc")


def added_blur_px(view: View, strengths: Strengths) -> NDArray[np.float64]:
    """Root of the variance (h, w) [px] that lens blur, corner blur and defocus add.

    Light is spread from where it comes from, so that a near body's blur reaches over a far one
    behind it (Potmesil and Chakravarty 1982, eqs. 1 to 5).
    """
    nominal = strengths.nominal
    even = max(strengths.of("lens_blur") ** 2 - nominal.lens_blur_px**2, 0.0)
    corner = (strengths.of("corner_blur") * nominal.radius()) ** 2
    inverse_m = np.nan_to_num(1.0 / view.depth_m)  # Where nothing is seen it is far.
    near = (strengths.of("near_defocus") * (inverse_m - 1.0 / nominal.lens_focus_m)) ** 2
    return np.sqrt(even + corner + near)


def vignetting(nominal: Nominal, exponent: float) -> NDArray[np.float64]:
    """Factor (h, w) by which a lens dims light off its axis.

    Two equal round stops some way apart, in place of cos^n: off the axis one covers part of the
    other, as far as two circles overlap (Smith, Modern Optical Engineering, ch. 6). The circles'
    shift grows with the tangent and is such that, of all cos^n, the page's fits the image best.
    """
    across, down = nominal.tangents()
    tangent = np.hypot(across, down)
    law = (1.0 + tangent**2) ** (-0.5 * exponent)
    slope = law * np.log1p(tangent**2)  # Of the law over n, but for a factor.

    def excess(shift: float) -> float:
        """Slope over n of the law's squared distance: 0 where no other n fits better."""
        return float(np.vdot(law - _overlap(shift * tangent), slope))

    shift = brentq(excess, 0.0, _FARTHEST_APART / float(tangent.max()))
    assert isinstance(shift, float)
    return _overlap(shift * tangent)


def veil(laser_e: Image, rest_e: Image, share: float) -> tuple[Image, Image]:
    """Scatter a share of all light over the image.

    The page spreads it evenly; here it is spread by a Gaussian so wide that it is nearly even, with
    mirrors at the border, so that the mean stays.

    Returns:
        What stays of the laser's light, and all other light with the veil (h, w).
    """
    if share == 0.0:
        return laser_e, rest_e
    sigma = _VEIL_WIDTH * max(laser_e.shape)
    waves = np.asarray(fft.dctn(laser_e + rest_e))  # Cosines have mirrors at the border.
    down, across = (np.pi * np.arange(n) / n for n in laser_e.shape)
    waves *= np.exp(-0.5 * sigma**2 * (down[:, None] ** 2 + across[None, :] ** 2))
    glare = np.asarray(fft.idctn(waves))
    return (1.0 - share) * laser_e, (1.0 - share) * rest_e + share * glare


def _overlap(apart: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of a circle of radius 1 that another one covers, their centres `apart`."""
    half = np.clip(0.5 * apart, 0.0, 1.0)
    return (2.0 / math.pi) * (np.arccos(half) - half * np.sqrt(1.0 - half**2))
