"""Light from the surfaces: ambient light, subsurface scattering, second projector, exposure."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.validation.camera import dots, spread
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import Image, LightView
from starling.diagnosis.validation.camera.nominal import Nominal

_PLANE_PX = 5  # Side of the window in which a surface normal is fitted [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ReceivedLight:
    """Light that one lens receives during the exposure, as electrons, (h, w) each."""

    laser_e: Image  # Light of the device's own projector; coherent, so it has speckle.
    rest_e: Image  # All other light.


def leave(view: LightView, strengths: Strengths) -> ReceivedLight:
    """Combine the light that one imager receives from the surfaces.

    Args:
        view: Light that includes the effects of the projector.
        strengths: Nominal camera and effect strengths.
    """
    nominal = strengths.nominal
    view = _inside_bodies(view, strengths)
    rest = view.ambient_e * strengths.value("ambient")
    if strengths.is_active("ambient_gradient"):
        up = facing_up(view, nominal)
        rendered = _under_gradient(nominal.ambient_gradient, up)
        rest = rest * (_under_gradient(strengths.value("ambient_gradient"), up) / rendered)
    second_w = strengths.value("second_projector")
    if second_w != 0.0:
        rest = rest + second_w * view.other_e
    time = strengths.value("exposure") / nominal.exposure_s
    return ReceivedLight(laser_e=view.laser_e * time, rest_e=rest * time)


def facing_up(view: LightView, nominal: Nominal) -> NDArray[np.float64]:
    """Return the cosine between surface normal and up (h, w), 0 where there is no surface.

    The inverse depth of a plane is affine in pixel coordinates. A least-squares fit of the slopes
    in a window (Savitzky and Golay) gives the normal of the plane.
    """
    x, y = nominal.tangents()
    inverse = 1.0 / view.depth_m
    steps = np.arange(_PLANE_PX) - _PLANE_PX // 2
    slope = steps[::-1] / (_PLANE_PX * float(steps @ steps))
    box = np.ones(_PLANE_PX)
    # A window across an edge or next to missing depth holds no plane; it takes the nearest normal.
    whole = _one_body(view)
    across = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 1), box, 0)
    down = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 0), box, 1)
    if not whole.any():
        return np.zeros(view.depth_m.shape)
    nearest = ndimage.distance_transform_edt(~whole, return_distances=False, return_indices=True)
    pixel = tuple(np.asarray(nearest))
    # 1 / z = (n . ray) / (n . p): nx and ny are proportional to the slopes; nz is the remainder.
    nx, ny = across[pixel] * nominal.fx_px, down[pixel] * nominal.fy_px
    nz = inverse[pixel] - nx * x[pixel] - ny * y[pixel]
    length = np.sqrt(nx**2 + ny**2 + nz**2)
    up = view.up
    towards = -(nx * up[0] + ny * up[1] + nz * up[2]) / length
    return np.where(view.body > 0, towards, 0.0)


def _under_gradient(gradient: float, up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ratio (h, w) of light under a sky gradient to that under a uniform sky (effect page)."""
    return 1.0 + 2.0 / 3.0 * gradient * up


def _one_body(view: LightView) -> NDArray[np.bool_]:
    """Pixels whose window lies on one body and has depth everywhere."""
    same = ndimage.minimum_filter(view.body, _PLANE_PX) == ndimage.maximum_filter(
        view.body, _PLANE_PX
    )
    known = ndimage.minimum_filter(np.isfinite(view.depth_m), _PLANE_PX)
    whole = same & known & (view.body > 0)
    rim = _PLANE_PX // 2
    inner = np.zeros_like(whole)
    inner[rim:-rim, rim:-rim] = whole[rim:-rim, rim:-rim]
    return inner


def _inside_bodies(view: LightView, strengths: Strengths) -> LightView:
    """Spread the projector's light inside each body.

    Diffuse light decays as exp(-r / l), not as a Gaussian (Jensen et al. 2001, eq. 4). The length l
    gives the variance of the effect page, (fx sigma / z)^2. A uniform pattern stays uniform.
    """
    sigma_m = strengths.value("subsurface")
    if sigma_m == 0.0:
        return view
    sigma_px = np.nan_to_num(strengths.nominal.fx_px * sigma_m / view.depth_m)
    lit, pattern = dots.lit(view), dots.pattern(view)
    spread_pattern = np.zeros_like(pattern)
    for body in np.unique(view.body[lit]):
        inside = lit & (view.body == body)
        body_pattern = np.where(inside, pattern, 0.0)
        spread_pattern += spread.scatter_within(body_pattern, sigma_px, "exponential", inside)
    return dataclasses.replace(view, laser_e=view.even_e * spread_pattern)
