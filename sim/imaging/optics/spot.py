"""The lens's spot: wider in the corners and out of focus, Gaussian or of another shape.

Variances of independent blurs add, so each pixel has one variance: uniform blur plus corner blur
plus defocus. Each pixel is interpolated linearly in variance between uniformly blurred images.
The second moment of its spot is then exact. A Gaussian spot stays Gaussian within 3 % of contrast;
`spot_shapes` has the other shapes.

Each pixel gathers light with its own spot. The model therefore omits light that a blurred near
object sheds over a sharp far one, and the loss at the near object's edge.
"""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.sim.arrays import Image
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.optics import spot_shapes
from starling.sim.sensor.imager import Lens

_NEAREST_M = 1e-3  # Defocus of nearer surfaces is that at this distance [m].
_STEP = 2.0  # Ratio of successive variances of the uniform blurs.

_FIRST_PX2 = 0.25  # Variance of the first blur [px^2].


def kernel(variance_px2: float) -> NDArray[np.float32]:
    """Return the discrete Gaussian exp(-t) I_n(t), with variance t and sum 1.

    A sampled Gaussian is too narrow below a pixel, by a fifth in variance at sigma 0.5 px. Nor do
    two in a row equal one with the summed variance. The discrete Gaussian has the right variance
    and this semigroup property for every t.

    Args:
        variance_px2: t [px^2], >= 0.

    Returns:
        (2 n + 1,) weights; n is 4 sigma + 1, which truncates 0.1 % of the variance.

    Source: Lindeberg, IEEE TPAMI 12(3), 1990, "Scale-space for discrete signals", eq. 19.
    """
    reach = int(np.ceil(4 * np.sqrt(variance_px2))) + 1
    weights = special.ive(np.abs(np.arange(-reach, reach + 1)), variance_px2)
    return (weights / weights.sum()).astype(np.float32)


def spread(
    radiance: Image, variance_px2: float, into: Image | None = None, *, shape: float = 0.0
) -> Image:
    """Blur with a spot of this variance [px^2]; the image is mirrored at its border.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        variance_px2: variance of the spot on each axis [px^2].
        into: array for the result; None allocates one.
        shape: -1 for a disc, 0 for a Gaussian, 1 for exponential tails; mixtures between.
    """
    weights = kernel(variance_px2)
    if shape != 0:
        spot = spot_shapes.mixed(weights, variance_px2, shape)
        shaped = cv2.filter2D(radiance, cv2.CV_32F, spot, dst=into, borderType=cv2.BORDER_REFLECT)
        return np.asarray(shaped, np.float32)
    blurred = cv2.sepFilter2D(
        radiance, cv2.CV_32F, weights, weights, dst=into, borderType=cv2.BORDER_REFLECT
    )
    return np.asarray(blurred, np.float32)


def blur(radiance: Image, sigma_px: float, *, shape: float = 0.0) -> Image:
    """Blur with the lens's spot; 0 px is the identity, bit for bit.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        sigma_px: standard deviation of the spot [px].
        shape: of the spot, as of `spread`.
    """
    if sigma_px == 0:
        return radiance
    return spread(radiance, sigma_px**2, shape=shape)


def variance(depth_m: Image, lens: Lens, pinhole: Pinhole) -> Image:
    """Return the variance of each pixel's spot, per axis.

    s^2 = blur^2 + corner^2 (r / r_h)^2 + (k |1/z - 1/z_f|)^2, with the distance r from the
    principal point and half the diagonal r_h. A thin lens of focal length f and aperture number N
    spreads a point over a disc of diameter f^2/N |1/z - 1/z_f|. The disc's sigma on each axis is a
    quarter of its diameter, so k = f^2 / (4 N pitch).

    Args:
        depth_m: (h, w) z of the surface in each pixel [m]; NaN counts as infinitely far.
        lens: supplies the blurs.
        pinhole: intrinsics of the image.

    Returns:
        (h, w) [px^2].

    Source: disc: Potmesil and Chakravarty, ACM TOG 1(2), 1982, eqs. 1 to 5, close to focus.
    """
    return _variance(
        depth_m,
        np.float32(lens.blur_px**2),
        np.float32((lens.corner_blur_px / pinhole.half_diagonal_px) ** 2),
        np.float32(pinhole.cx_px),
        np.float32(pinhole.cy_px),
        np.float32(lens.defocus_px_m),
        np.float32(1 / lens.focus_m),
        np.float32(1 / _NEAREST_M),
    )


def levels(least_px2: float, most_px2: float) -> list[float]:
    """Return the variances of the uniform blurs [px^2], ascending."""
    variances = [least_px2]
    while variances[-1] < most_px2:
        variances.append(min(most_px2, max(_STEP * variances[-1], variances[-1] + _FIRST_PX2)))
    return variances


def blur_by_spot(parts: tuple[Image, ...], depth_m: Image, lens: Lens, pinhole: Pinhole) -> tuple:
    """Blur images of one view with the lens's spot; the identity if the spot is a point.

    Args:
        parts: images (h, w) of separate lights.
        depth_m: (h, w) z of the surface in each pixel [m], NaN without a surface.
        lens: supplies the blurs.
        pinhole: intrinsics of the image.
    """
    if lens.corner_blur_px == 0 and lens.defocus_px_m == 0:
        return tuple(blur(part, lens.blur_px, shape=lens.spot_shape) for part in parts)
    wanted = variance(depth_m, lens, pinhole)
    steps = levels(float(wanted.min()), float(wanted.max()))
    return tuple(_interpolated(part, wanted, steps, lens.spot_shape) for part in parts)


def _interpolated(part: Image, wanted: Image, steps: list[float], shape: float) -> Image:
    stack = np.empty((len(steps), *part.shape), np.float32)
    if shape != 0:  # Two discs in a row are no disc.
        for number, step in enumerate(steps):
            spread(part, step, into=stack[number], shape=shape)
        return _between(stack, np.array(steps, np.float32), wanted)
    spread(part, steps[0], into=stack[0])
    for number in range(1, len(steps)):
        added = steps[number] - steps[number - 1]
        spread(stack[number - 1], added, into=stack[number])
    return _between(stack, np.array(steps, np.float32), wanted)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _variance(depth_m, even, corner, cx, cy, defocus, focus, most):  # pragma: no cover - compiled
    h, w = depth_m.shape
    out = np.empty((h, w), np.float32)
    for y in range(h):
        for x in range(w):
            inverse = min(np.float32(1) / depth_m[y, x], most)
            if np.isnan(depth_m[y, x]):
                inverse = np.float32(0)
            across, down = np.float32(x) - cx, np.float32(y) - cy
            off = defocus * (inverse - focus)
            out[y, x] = even + corner * (across * across + down * down) + off * off
    return out


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _between(stack, steps, wanted):  # pragma: no cover - compiled
    n, h, w = stack.shape
    if n == 1:
        return stack[0]
    out = np.empty((h, w), np.float32)
    for y in range(h):
        for x in range(w):
            i = 0
            while i < n - 2 and wanted[y, x] > steps[i + 1]:
                i += 1
            share = (wanted[y, x] - steps[i]) / (steps[i + 1] - steps[i])
            out[y, x] = stack[i, y, x] + share * (stack[i + 1, y, x] - stack[i, y, x])
    return out
