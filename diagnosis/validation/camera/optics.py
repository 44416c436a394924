"""Optics: blur, vignetting, veiling glare, residual alignment and laser speckle."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import j1

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import LightView
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image

_TAIL_HALO = 0.41  # Share of a halo with the fourth moment of exponential tails.
_FARTHEST_APART = 8.0  # Upper bound of the stops' shift at the image corner [radii].
_VEIL_WIDTH = 0.75  # Sigma of the scattered light over the longer side of the image.
_NEWTON_STEPS = 8  # More than enough from a start within a pixel of the solution.
_LAGS = 2  # Largest pixel distance with modelled correlation of speckle [px].
_FINE = 24  # Quadrature points per pixel.


def focus(light_e: Image, view: LightView, strengths: Strengths) -> Image:
    """Blur light (h, w) by the spot of the lens.

    The nominal lens has a Gaussian spot, with a halo or a disc if `Nominal.lens_halo` or
    `Nominal.lens_disc` is set. Added variance has the shape of a disc, the spot of a defocused
    round aperture. Removed variance narrows the spot.
    """
    nominal_px = strengths.nominal.lens_blur_px
    narrow_px = min(nominal_px, strengths["lens_blur"])
    sharp = psf.with_halo(light_e, narrow_px, strengths.nominal.lens_halo)
    disc = strengths.nominal.lens_disc
    if disc > 0.0:
        spot = psf.kernel("disc", narrow_px)
        sharp = (1.0 - disc) * sharp + disc * psf.blur(light_e, spot)
    shape = strengths["spot_shape"]
    if shape != 0.0:
        sharp = (1.0 - abs(shape)) * sharp + abs(shape) * _shaped(light_e, narrow_px, shape)
    return psf.scatter(sharp, added_blur_px(view, strengths), "disc")


def _shaped(light_e: Image, sigma_px: float, shape: float) -> Image:
    """Blur by the spot at one end of `spot_shape`: a disc, or two Gaussians for the tails."""
    if shape < 0.0:
        return psf.blur(light_e, psf.kernel("disc", sigma_px))
    return psf.with_halo(light_e, sigma_px, _TAIL_HALO)


def added_blur_px(view: LightView, strengths: Strengths) -> Image:
    """Return the standard deviation (h, w) [px] that lens blur, corner blur and defocus add.

    Each source pixel spreads its light, so the blur of a near body extends over a far one behind
    it (Potmesil and Chakravarty 1982, eqs. 1 to 5).
    """
    nominal = strengths.nominal
    even = max(strengths["lens_blur"] ** 2 - nominal.lens_blur_px**2, 0.0)
    corner = (strengths["corner_blur"] * nominal.radius()) ** 2
    inverse_m = np.nan_to_num(1.0 / view.depth_m)  # Missing depth counts as infinitely far.
    near = (strengths["near_defocus"] * (inverse_m - 1.0 / nominal.lens_focus_m)) ** 2
    return np.sqrt(even + corner + near)


def vignetting(nominal: Nominal, exponent: float) -> Image:
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


def _overlap(distance: Image) -> Image:
    """Overlap of two unit circles at a distance of their centres, over the area of one circle."""
    half = np.clip(0.5 * distance, 0.0, 1.0)
    return (2.0 / math.pi) * (np.arccos(half) - half * np.sqrt(1.0 - half**2))


@dataclass(frozen=True, kw_only=True, slots=True)
class ResidualAlignment:
    """Residual rectification error of one image, with the signs of the project conventions."""

    offset_x_px: float = 0.0  # Content moves right.
    offset_y_px: float = 0.0  # Content moves down.
    roll_deg: float = 0.0  # The imager turns clockwise.
    pitch_deg: float = 0.0  # It looks up.
    yaw_deg: float = 0.0  # It looks right.
    magnification: float = 1.0
    distortion_px: float = 0.0  # Outwards at half the diagonal.


def imager_alignment(side: str, strengths: Strengths) -> ResidualAlignment:
    """Return the residual alignment of one imager.

    Both images have the focal scale. All other terms apply to the right image only.
    """
    both = ResidualAlignment(magnification=strengths["focal_scale"])
    if side == "left":
        return both
    return dataclasses.replace(
        both,
        offset_x_px=strengths["disparity_offset"],
        offset_y_px=strengths["vertical_offset"],
        roll_deg=strengths["roll"],
        pitch_deg=strengths["pitch"],
        yaw_deg=strengths["yaw"],
        distortion_px=strengths["distortion"],
    )


def resample(image: Image, alignment: ResidualAlignment, nominal: Nominal) -> Image:
    """Resample an image (h, w) with a residual alignment.

    Rotations of the rays are exact, not first order. Newton's method inverts the distortion. The
    interpolation uses cubic splines and repeats the border pixel.

    Returns:
        Image (h, w), clipped at 0, or `image` itself if there is no residual alignment.
    """
    if alignment == ResidualAlignment():
        return image
    x, y = source_coordinates(alignment, nominal)
    moved = ndimage.map_coordinates(image, [y, x], order=3, mode="nearest")
    return np.clip(moved, 0.0, None)


def source_coordinates(alignment: ResidualAlignment, nominal: Nominal) -> tuple[Image, Image]:
    """Return the position in the aligned image that each pixel shows: x and y (h, w) [px]."""
    x = np.arange(nominal.width)[None, :] - alignment.offset_x_px - nominal.cx_px
    y = np.arange(nominal.height)[:, None] - alignment.offset_y_px - nominal.cy_px
    x, y = np.broadcast_arrays(x, y)
    shrink = _undistort(np.hypot(x, y), alignment.distortion_px, nominal.half_diagonal_px)
    scale = shrink / alignment.magnification
    rays = np.stack([x * scale / nominal.fx_px, y * scale / nominal.fy_px, np.ones(x.shape)], -1)
    angles = (alignment.pitch_deg, alignment.yaw_deg, alignment.roll_deg)
    if any(angles):
        rays = rays @ Rotation.from_rotvec(np.radians(angles)).as_matrix().T
    x = nominal.fx_px * rays[..., 0] / rays[..., 2] + nominal.cx_px
    y = nominal.fy_px * rays[..., 1] / rays[..., 2] + nominal.cy_px
    return x, y


def _undistort(radius: Image, shift_px: float, unit_px: float) -> Image:
    """Return r / radius, where r solves r + shift (r / unit)^3 = radius [px]."""
    if shift_px == 0.0:
        return np.ones(radius.shape)
    bend = shift_px / unit_px**3
    r = radius.copy()
    for _ in range(_NEWTON_STEPS):
        r -= (r + bend * r**3 - radius) / (1.0 + 3.0 * bend * r**2)
    return np.where(radius > 0, r / np.maximum(radius, math.ulp(1.0)), 1.0)


def speckle(
    shape: tuple[int, int], contrast: float, nominal: Nominal, rng: np.random.Generator
) -> Image:
    """Draw the multiplicative speckle of laser light.

    The field is log-normal, where the simulator uses a gamma law. It has mean 1 and, as the
    glossary defines contrast, standard deviation `contrast` per pixel. Pixels are correlated as
    area averages of speckle.

    Args:
        shape: (h, w).
        contrast: Standard deviation over mean of a pixel.
        nominal: The camera.
        rng: Scene stream of one imager.

    Returns:
        Factor (h, w), > 0.
    """
    if contrast == 0.0:
        return np.ones(shape)
    log_variance = math.log1p(contrast**2)
    normal = _correlated(shape, _correlation(nominal), log_variance, rng)
    return np.exp(math.sqrt(log_variance) * normal - 0.5 * log_variance)


def _correlation(nominal: Nominal) -> Image:
    """Return the correlation of pixels at lags 0 to `_LAGS` along both axes.

    Behind a round aperture the correlation of speckle intensity is (2 J1(u) / u)^2 with
    u = pi r / (lambda F) (Goodman, Speckle Phenomena in Optics, 2007, sec. 4.4). A pixel averages
    over its area, which weights an offset x by 1 - |x| along each axis.
    """
    width_px = nominal.wavelength_nm * 1e-9 * nominal.f_number / nominal.pixel_pitch_m
    offset_px = (np.arange(-(_LAGS + 1) * _FINE, (_LAGS + 1) * _FINE) + 0.5) / _FINE
    u = math.pi * np.hypot(offset_px[:, None], offset_px[None, :]) / width_px
    intensity = (2.0 * j1(u) / u) ** 2
    weight = np.clip(1.0 - np.abs(offset_px[None, :] - np.arange(_LAGS + 1)[:, None]), 0.0, None)
    shared = weight @ intensity @ weight.T
    return shared / shared[0, 0]


def _correlated(
    shape: tuple[int, int],
    correlation: Image,
    log_variance: float,
    rng: np.random.Generator,
) -> Image:
    """Draw standard normals whose exponentials have the correlation (translation process)."""
    target = np.log1p(np.expm1(log_variance) * correlation) / log_variance
    height, width = shape
    autocorrelation = np.zeros(shape)
    for y in range(-_LAGS, _LAGS + 1):
        for x in range(-_LAGS, _LAGS + 1):
            autocorrelation[y % height, x % width] = target[abs(y), abs(x)]
    power = np.clip(np.fft.rfft2(autocorrelation).real, 0.0, None)
    white = np.fft.rfft2(rng.standard_normal(shape))
    normal = np.fft.irfft2(white * np.sqrt(power), s=shape)
    # Clipping the spectrum changes the variance slightly.
    variance = float(np.fft.irfft2(power, s=shape)[0, 0])
    return normal / math.sqrt(variance)
