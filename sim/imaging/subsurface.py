"""Light that spreads inside a body before it returns: wax, skin, marble, milky plastic."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from starling.sim.arrays import Image
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

_LEAST_PX = 0.5  # Narrower Gaussians are mixed from this one and no blur; they are undersampled.
_STEP = 2**0.5  # Ratio of successive computed widths.
_COARSE_PX = 8.0  # Wider Gaussians are computed on a smaller image [px].


def spread(
    light: Image, depth_m: Image, body: NDArray[np.uint32], scene: Scene, sensor: Sensor
) -> Image:
    """Spread the light of the finish's bodies by a Gaussian of fixed size on the surface.

    In pixels, sigma is fx sigma_m / z with the pixel's depth z. Each body keeps its light: the
    Gaussian is normalised over the body's pixels. The surface is assumed to face the imager, so
    the blur on a tilted surface is not foreshortened. Parts of a body at different depths mix
    where one occludes the other.

    Args:
        light: (h, w) radiance; pass the projector's light only, to spread only its dots.
        depth_m: (h, w) z [m] of the rendered view.
        body: (h, w) body numbers of the rendered view, from 1 in the order of the bodies.
        scene: its finish names the bodies and the width.
        sensor: supplies the focal lengths.

    Returns:
        The spread light, or the input array if no light spreads. Shapes with their own BSDF are
        unaffected, as by all of the finish.

    Source: exponential profile of the dipole (Jensen et al., A practical model for subsurface
    light transport, 2001, eq. 4). A Gaussian with the same second moment replaces it.
    """
    finish = scene.finish
    if finish.subsurface_m == 0 or not scene.bodies or not light.any():
        return light
    windows = find_objects(body.astype(np.int32), max_label=len(scene.bodies))
    out = light
    for number, (part, window) in enumerate(zip(scene.bodies, windows, strict=True), start=1):
        if window is None or not finish.touches(part.name):
            continue
        out = light.copy() if out is light else out
        inside = body[window] == number
        sigma_px = np.float32(sensor.fx_px * finish.subsurface_m) / depth_m[window]
        _spread(out[window], light[window], inside, sigma_px, sensor.fy_px / sensor.fx_px)
    return out


def _spread(
    out: Image, light: Image, inside: NDArray[np.bool_], sigma_px: Image, aspect: float
) -> None:
    """Fill `out` inside the body: Gaussians of fixed widths, mixed to each pixel's variance."""
    widths = _widths(
        float(sigma_px.min(where=inside, initial=np.inf)),
        float(sigma_px.max(where=inside, initial=0)),
    )
    weight = inside.astype(np.float32)
    light_inside = light * weight
    totals, shares = np.empty((2, len(widths), *light.shape), np.float32)
    for total, share, width in zip(totals, shares, widths, strict=True):
        total[:], share[:] = (_gaussian(image, width, aspect) for image in (light_inside, weight))
    _mix(out, inside, sigma_px, np.array(widths, np.float32), totals, shares)


@nb.njit(nogil=True, cache=True)
def _mix(out, inside, sigma_px, widths, totals, shares):  # pragma: no cover - compiled
    """Normalise by the body's share of each Gaussian, and mix the two nearest widths."""
    last = len(widths) - 1
    least = np.float32(1e-6)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            if not inside[row, column]:
                continue
            sigma = sigma_px[row, column]
            low = 0
            while low < last - 1 and widths[low + 1] < sigma:
                low += 1
            narrow = totals[low, row, column] / max(shares[low, row, column], least)
            if low < last and sigma > widths[low]:
                wide = totals[low + 1, row, column] / max(shares[low + 1, row, column], least)
                step = widths[low + 1] ** 2 - widths[low] ** 2
                part = (sigma**2 - widths[low] ** 2) / step
                narrow += min(max(part, np.float32(0)), np.float32(1)) * (wide - narrow)
            out[row, column] = narrow


def _widths(least: float, most: float) -> list[float]:
    """Return the sigmas [px] to compute, which enclose `least` to `most`."""
    widths = [0.0, _LEAST_PX] if least < _LEAST_PX else [least]
    start = widths[-1]
    count = int(np.ceil(np.log(max(most / start, 1)) / np.log(_STEP)))
    return [*widths, *(start * (most / start) ** (i / count) for i in range(1, count + 1))]


def _gaussian(image: Image, sigma_px: float, aspect: float) -> Image:
    """Gaussian blur with a zero border; wide Gaussians are computed on a smaller image.

    The smaller image moves light to the centre of a large pixel, by up to an eighth of sigma.
    """
    if sigma_px == 0:
        return image
    if sigma_px <= _COARSE_PX:
        return _blurred(image, sigma_px, aspect)
    shrink = int(2 * sigma_px / _COARSE_PX)
    rows, columns = image.shape
    padded = np.pad(
        image, ((shrink, 2 * shrink - rows % shrink), (shrink, 2 * shrink - columns % shrink))
    )
    size = padded.shape[::-1]
    small = cv2.resize(padded, (size[0] // shrink, size[1] // shrink), interpolation=cv2.INTER_AREA)
    # Shrinking (box filter) and enlarging (triangle filter) already add variance.
    small_sigma_px = float(np.sqrt(sigma_px**2 - shrink**2 / 4)) / shrink
    large = cv2.resize(
        _blurred(np.asarray(small, np.float32), small_sigma_px, aspect),
        size,
        interpolation=cv2.INTER_LINEAR,
    )
    return np.asarray(large[shrink : shrink + rows, shrink : shrink + columns], np.float32)


def _blurred(image: Image, sigma_px: float, aspect: float) -> Image:
    blurred = cv2.GaussianBlur(
        image, (0, 0), sigma_px, sigmaY=sigma_px * aspect, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(blurred, np.float32)
