"""Light that leaves the surfaces: sky, light inside bodies, another projector, exposure."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.validation.camera import dots, spread
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import Image, View
from starling.diagnosis.validation.camera.nominal import Nominal

_PLANE_PX = 5  # Side of the window that a normal is fitted to.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Arriving:
    """Light that arrives at one lens, in electrons of the exposure, (h, w) each."""

    laser_e: Image  # The own projector's: coherent, so it has grain.
    rest_e: Image  # All other.


def leave(view: View, strengths: Strengths) -> Arriving:
    """Add up what the surfaces send to one imager.

    Args:
        view: Light with the projector's effects.
        strengths: The effects.
    """
    nominal = strengths.nominal
    view = _inside_bodies(view, strengths)
    rest = view.ambient_e * strengths.of("ambient")
    if strengths.acting("ambient_gradient"):
        up = facing_up(view, nominal)
        rendered = _under_gradient(nominal.ambient_gradient, up)
        rest = rest * (_under_gradient(strengths.of("ambient_gradient"), up) / rendered)
    other_w = strengths.of("second_projector")
    if other_w != 0.0:
        rest = rest + other_w * view.other_e
    time = strengths.of("exposure") / nominal.exposure_s
    return Arriving(laser_e=view.laser_e * time, rest_e=rest * time)


def facing_up(view: View, nominal: Nominal) -> NDArray[np.float64]:
    """Cosine between the surfaces' normals and up (h, w), 0 where there is no surface.

    The inverse depth of a plane is affine in the pixel: its slopes, found by least squares over a
    window (Savitzky and Golay), give the normal of the plane through the window.
    """
    x, y = nominal.tangents()
    inverse = 1.0 / view.depth_m
    steps = np.arange(_PLANE_PX) - _PLANE_PX // 2
    slope = steps[::-1] / (_PLANE_PX * float(steps @ steps))
    box = np.ones(_PLANE_PX)
    # Across an edge, or beside nothing, a window holds no plane: the nearest that does stands in.
    whole = _one_body(view)
    across = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 1), box, 0)
    down = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 0), box, 1)
    if not whole.any():
        return np.zeros(view.depth_m.shape)
    nearest = ndimage.distance_transform_edt(~whole, return_distances=False, return_indices=True)
    at = tuple(np.asarray(nearest))
    # 1 / z = (n . ray) / (n . p): n is proportional to the slopes, and the rest along z.
    nx, ny = across[at] * nominal.fx_px, down[at] * nominal.fy_px
    nz = inverse[at] - nx * x[at] - ny * y[at]
    length = np.sqrt(nx**2 + ny**2 + nz**2)
    up = view.up
    towards = -(nx * up[0] + ny * up[1] + nz * up[2]) / length
    return np.where(view.body > 0, towards, 0.0)


def _under_gradient(gradient: float, up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light of a tilted sky over that of an even one (h, w), by the cosine to up: the page's."""
    return 1.0 + 2.0 / 3.0 * gradient * up


def _one_body(view: View) -> NDArray[np.bool_]:
    """Pixels whose window lies on one body with depth everywhere."""
    same = ndimage.minimum_filter(view.body, _PLANE_PX) == ndimage.maximum_filter(
        view.body, _PLANE_PX
    )
    known = ndimage.minimum_filter(np.isfinite(view.depth_m), _PLANE_PX)
    whole = same & known & (view.body > 0)
    rim = _PLANE_PX // 2
    inner = np.zeros_like(whole)
    inner[rim:-rim, rim:-rim] = whole[rim:-rim, rim:-rim]
    return inner


def _inside_bodies(view: View, strengths: Strengths) -> View:
    """Spread the projector's light inside each body.

    Diffusing light dies off as exp(-r / l) and not as a Gaussian (Jensen et al. 2001, eq. 4); l is
    such that the variance is that of the page, (fx sigma / z)^2. What is even stays even.
    """
    sigma_m = strengths.of("subsurface")
    if sigma_m == 0.0:
        return view
    sigma_px = np.nan_to_num(strengths.nominal.fx_px * sigma_m / view.depth_m)
    lit, pattern = dots.lit(view), dots.pattern(view)
    spread_pattern = np.zeros_like(pattern)
    for body in np.unique(view.body[lit]):
        inside = lit & (view.body == body)
        there = np.where(inside, pattern, 0.0)
        spread_pattern += spread.scatter_within(there, sigma_px, "exponential", inside)
    return dataclasses.replace(view, laser_e=view.even_e * spread_pattern)
