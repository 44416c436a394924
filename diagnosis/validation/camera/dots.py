"""The projector's dots as both imagers see them, and what becomes of them one by one.

Light of dots over even light is the pattern itself, free of surfaces and shadows. Its maxima, taken
to the projector's frame, are the dots, the same for both imagers and all scenes. What the pattern
has between them is even light of no dot, which stays whatever becomes of the dots.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from starling.diagnosis.validation.camera import spread
from starling.diagnosis.validation.camera.light import SIDES, Light, View

_GROUND_PERCENTILE = 10.0  # Far enough from any dot; not the least, which grain takes too low.
_LIT = 1e-4  # Of the brightest even light: below it a surface does not face the projector.
_FLATTEN_PX = 0.7  # Keeps a renderer's grain from making dots of its own.
_TALL = 1.2  # Least height of a dot over the mean.
_APART_PX = 1.6  # Dots nearer to each other than this are one, seen twice.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Dots:
    """Directions of a projector's dots, found in the light of its scenes."""

    tangents: NDArray[np.float64]  # (n, 2): x / z and y / z in the projector's frame.

    def owner(self, view: View) -> NDArray[np.intp]:
        """Number of the dot that lights each pixel (h, w): the nearest in direction; -1 if none."""
        seen = np.isfinite(view.px) & np.isfinite(view.py)
        out = np.full(view.px.shape, -1, np.intp)
        if len(self.tangents):
            directions = np.stack([view.px[seen], view.py[seen]], 1)
            out[seen] = KDTree(self.tangents).query(directions)[1]
        return out


def pattern(view: View) -> NDArray[np.float64]:
    """Light of the dots over even light (h, w): mean about 1, 0 where no light arrives."""
    on = lit(view)
    return np.where(on, view.laser_e / np.where(on, view.even_e, 1.0), 0.0)


def ground(view: View) -> NDArray[np.float64]:
    """Part of the pattern (h, w) that is even light of no dot: one share, 0 where no light arrives.

    The share is what the pattern falls to between the dots.
    """
    whole, on = pattern(view), lit(view)
    share = float(np.percentile(whole[on], _GROUND_PERCENTILE)) if on.any() else 0.0
    return np.minimum(whole, share)


def lit(view: View) -> NDArray[np.bool_]:
    """Pixels (h, w) that see a surface the projector reaches."""
    brightest = float(view.even_e.max(initial=0.0))
    return (view.even_e > _LIT * brightest) & np.isfinite(view.px)


def gather(lights: Iterable[Light], focal_px: float) -> Dots:
    """Find the dots of a projector in several scenes.

    Args:
        lights: The scenes.
        focal_px: Focal length of the imagers [px], which tells how far apart dots can be seen.
    """
    tangents = np.empty((0, 2))
    for light in lights:
        for side in SIDES:
            found = _find(light.view(side))
            if len(tangents) and len(found):
                away = KDTree(tangents).query(found)[0]
                found = found[away > _APART_PX / focal_px]
            tangents = np.concatenate([tangents, found])
    return Dots(tangents=tangents)


def dropped(view: View, dots: Dots, share: float, rng: np.random.Generator) -> View:
    """Darken every dot with a probability; the others and the even ground stay as they are.

    A dot is the light over the ground that is nearest to its direction.

    Args:
        view: What an imager sees.
        dots: The projector's dots.
        share: Probability, 0 to 1.
        rng: The projector's own; both imagers and all scenes need the same draws.
    """
    if share == 0.0:
        return view
    dark = np.append(rng.random(len(dots.tangents)) < share, False)
    return _relight(view, np.where(dark[dots.owner(view)], ground(view), pattern(view)))


def shifted(
    view: View, dots: Dots, sigma_mrad: float, focal_px: float, rng: np.random.Generator
) -> View:
    """Displace every dot by two normal deviates; the even ground stays.

    A dot's light is what its cell has over the ground. It is carried in image space, and laid down
    by cubic convolution weights (Keys, IEEE TASSP 29 (1981) 1153, eq. 4), which move a spot by a
    part of a pixel without widening it.

    Args:
        view: What an imager sees.
        dots: The projector's dots.
        sigma_mrad: Deviation along each axis [mrad].
        focal_px: Focal length of the imager [px].
        rng: The projector's own; both imagers and all scenes need the same draws.
    """
    if sigma_mrad == 0.0:
        return view
    angles = rng.standard_normal((len(dots.tangents), 2)) * sigma_mrad * 1e-3
    # A small angle moves a tangent t by (1 + t^2).
    move_px = np.append(focal_px * angles * (1.0 + dots.tangents**2), [[0.0, 0.0]], axis=0)
    moved = move_px[dots.owner(view)]
    even = ground(view)
    laid = _lay_down(pattern(view) - even, moved[..., 0], moved[..., 1])
    return _relight(view, even + laid)


def widened(view: View, added: spread.Ellipse) -> View:
    """Widen the dots where they fall, shading and shadows staying sharp.

    Args:
        view: What an imager sees.
        added: What is added to a spot's own.
    """
    if float((added.xx + added.yy).max()) == 0.0:
        return view
    return _relight(view, spread.ellipses_within(pattern(view), added, lit(view)))


def doubled(view: View, share: float, shift_px: tuple[float, float]) -> View:
    """Add a second, dimmer pattern beside the first, as a plate's inner reflection does.

    Args:
        view: What an imager sees.
        share: Light of the second over that of the first.
        shift_px: Where it falls (x, y): a fixed angle, so fixed in pixels [px].
    """
    if share == 0.0:
        return view
    even = ground(view)
    first = pattern(view) - even
    second = ndimage.shift(first, shift_px[::-1], order=1, mode="nearest")
    return _relight(view, even + (first + share * second) / (1.0 + share))


def _find(view: View) -> NDArray[np.float64]:
    """Directions (n, 2) of the dots in one view, each the centroid of its 3x3 pixels."""
    on = lit(view)
    smooth = ndimage.gaussian_filter(pattern(view), _FLATTEN_PX)
    tall = smooth > _TALL * np.mean(smooth, where=on) if on.any() else on
    top = (smooth == ndimage.maximum_filter(smooth, 3)) & tall & on
    weight = ndimage.uniform_filter(np.where(on, smooth, 0.0), 3)
    centres = [
        ndimage.uniform_filter(np.where(on, smooth * tangent, 0.0), 3)[top] / weight[top]
        for tangent in (view.px, view.py)
    ]
    return np.stack(centres, 1)


def _relight(view: View, new_pattern: NDArray[np.float64]) -> View:
    return dataclasses.replace(view, laser_e=view.even_e * new_pattern)


def _lay_down(
    values: NDArray[np.float64], dx_px: NDArray[np.float64], dy_px: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Carry every pixel's value to its place (h, w); what leaves the image is lost."""
    height, width = values.shape
    rows, columns = np.indices(values.shape)
    x, y = columns + dx_px, rows + dy_px
    left, top = np.floor(x), np.floor(y)
    out = np.zeros(values.size)
    for j in range(-1, 3):
        for i in range(-1, 3):
            at_x, at_y = left + i, top + j
            held = (at_x >= 0) & (at_x < width) & (at_y >= 0) & (at_y < height)
            weight = (values * _keys(at_x - x) * _keys(at_y - y))[held]
            place = (at_y[held] * width + at_x[held]).astype(np.intp)
            out += np.bincount(place, weight, values.size)
    return np.clip(out.reshape(values.shape), 0.0, None)


def _keys(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cubic convolution weight at a distance [px], a = -1/2 (Keys 1981, eq. 15)."""
    s = np.abs(distance)
    near = (1.5 * s - 2.5) * s * s + 1.0
    far = ((-0.5 * s + 2.5) * s - 4.0) * s + 2.0
    return np.where(s < 1.0, near, np.where(s < 2.0, far, 0.0))
