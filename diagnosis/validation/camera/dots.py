"""Dots of the projector, and effects that change single dots.

The ratio of dot light to uniform light is the pattern, free of surfaces and shadows. Its maxima in
the frame of the projector are the dots, equal for both imagers and all scenes. Between the dots the
pattern has a uniform background, which no effect on dots changes.
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
from starling.diagnosis.validation.camera.light import SIDES, LightView, SceneLight

_BACKGROUND_PERCENTILE = 10.0  # Level between dots; render noise biases the minimum downwards.
_LIT = 1e-4  # Uniform light over its maximum below which a surface counts as unlit.
_FLATTEN_PX = 0.7  # Gaussian sigma [px]; removes false maxima due to render noise.
_TALL = 1.2  # Least height of a dot over the mean of the pattern.
_APART_PX = 1.6  # Maxima from two views closer than this are the same dot [px].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProjectorDots:
    """Directions of the dots of a projector, detected in the light of its scenes."""

    tangents: NDArray[np.float64]  # (n, 2): x / z and y / z in the projector's frame.

    def owner(self, view: LightView) -> NDArray[np.intp]:
        """Return the index (h, w) of the dot nearest in direction to each pixel, -1 if none."""
        seen = np.isfinite(view.px) & np.isfinite(view.py)
        out = np.full(view.px.shape, -1, np.intp)
        if len(self.tangents):
            directions = np.stack([view.px[seen], view.py[seen]], 1)
            out[seen] = KDTree(self.tangents).query(directions)[1]
        return out


def pattern(view: LightView) -> NDArray[np.float64]:
    """Return the pattern (h, w): dot light over uniform light, mean about 1, 0 where unlit."""
    on = lit(view)
    return np.where(on, view.laser_e / np.where(on, view.even_e, 1.0), 0.0)


def background(view: LightView) -> NDArray[np.float64]:
    """Return the uniform background of the pattern (h, w): its level between dots, 0 if unlit."""
    whole, on = pattern(view), lit(view)
    share = float(np.percentile(whole[on], _BACKGROUND_PERCENTILE)) if on.any() else 0.0
    return np.minimum(whole, share)


def lit(view: LightView) -> NDArray[np.bool_]:
    """Return a mask (h, w) of the pixels that see a surface lit by the projector."""
    brightest = float(view.even_e.max(initial=0.0))
    return (view.even_e > _LIT * brightest) & np.isfinite(view.px)


def gather(lights: Iterable[SceneLight], focal_px: float) -> ProjectorDots:
    """Detect the dots of a projector in several scenes.

    Args:
        lights: Light of the scenes.
        focal_px: Focal length of the imagers [px]. It converts the merging distance to tangents.
    """
    tangents = np.empty((0, 2))
    for light in lights:
        for side in SIDES:
            detected = _detect(light.view(side))
            if len(tangents) and len(detected):
                distance = KDTree(tangents).query(detected)[0]
                detected = detected[distance > _APART_PX / focal_px]
            tangents = np.concatenate([tangents, detected])
    return ProjectorDots(tangents=tangents)


def dropped(
    view: LightView, dots: ProjectorDots, share: float, rng: np.random.Generator
) -> LightView:
    """Switch off each dot with a probability. Other dots and the background stay unchanged.

    A dot owns the light above the background in all pixels nearest to its direction.

    Args:
        view: Light of one imager.
        dots: Dots of the projector.
        share: Probability, 0 to 1.
        rng: Stream of the projector, equal for both imagers and all scenes.
    """
    if share == 0.0:
        return view
    dark = np.append(rng.random(len(dots.tangents)) < share, False)
    return _relight(view, np.where(dark[dots.owner(view)], background(view), pattern(view)))


def shifted(
    view: LightView,
    dots: ProjectorDots,
    sigma_mrad: float,
    focal_px: float,
    rng: np.random.Generator,
) -> LightView:
    """Displace each dot by a normal deviate along each axis. The background stays unchanged.

    The light of a dot is the light of its cell above the background. It moves in image space with
    cubic convolution weights (Keys, IEEE TASSP 29 (1981) 1153, eq. 4). They shift a spot by a
    fraction of a pixel without widening it.

    Args:
        view: Light of one imager.
        dots: Dots of the projector.
        sigma_mrad: Standard deviation along each axis [mrad].
        focal_px: Focal length of the imager [px].
        rng: Stream of the projector, equal for both imagers and all scenes.
    """
    if sigma_mrad == 0.0:
        return view
    angles = rng.standard_normal((len(dots.tangents), 2)) * sigma_mrad * 1e-3
    # A small angle moves a tangent t by (1 + t^2).
    move_px = np.append(focal_px * angles * (1.0 + dots.tangents**2), [[0.0, 0.0]], axis=0)
    moved = move_px[dots.owner(view)]
    even = background(view)
    shifted_dots = _splat(pattern(view) - even, moved[..., 0], moved[..., 1])
    return _relight(view, even + shifted_dots)


def widened(view: LightView, added: spread.Ellipse) -> LightView:
    """Widen the dots in the image. Shading and shadows stay sharp.

    Args:
        view: Light of one imager.
        added: Variances added to the spot of each pixel.
    """
    if float((added.xx + added.yy).max()) == 0.0:
        return view
    return _relight(view, spread.ellipses_within(pattern(view), added, lit(view)))


def doubled(view: LightView, share: float, shift_px: tuple[float, float]) -> LightView:
    """Add a second, dimmer copy of the pattern, as an internal reflection in a plate does.

    Args:
        view: Light of one imager.
        share: Light of the second pattern over that of the first.
        shift_px: Shift of the second pattern (x, y) [px]; the angle between both is constant.
    """
    if share == 0.0:
        return view
    even = background(view)
    first = pattern(view) - even
    second = ndimage.shift(first, shift_px[::-1], order=1, mode="nearest")
    return _relight(view, even + (first + share * second) / (1.0 + share))


def _detect(view: LightView) -> NDArray[np.float64]:
    """Directions (n, 2) of the dots in one view: the centroid of 3 x 3 pixels at each maximum."""
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


def _relight(view: LightView, new_pattern: NDArray[np.float64]) -> LightView:
    return dataclasses.replace(view, laser_e=view.even_e * new_pattern)


def _splat(
    values: NDArray[np.float64], dx_px: NDArray[np.float64], dy_px: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Add the value of every pixel at its displaced position (h, w), with loss at the border."""
    height, width = values.shape
    rows, columns = np.indices(values.shape)
    x, y = columns + dx_px, rows + dy_px
    left, top = np.floor(x), np.floor(y)
    out = np.zeros(values.size)
    for j in range(-1, 3):
        for i in range(-1, 3):
            target_x, target_y = left + i, top + j
            inside = (target_x >= 0) & (target_x < width) & (target_y >= 0) & (target_y < height)
            weight = (values * _keys(target_x - x) * _keys(target_y - y))[inside]
            target = (target_y[inside] * width + target_x[inside]).astype(np.intp)
            out += np.bincount(target, weight, values.size)
    return np.clip(out.reshape(values.shape), 0.0, None)


def _keys(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cubic convolution weight at a distance [px], a = -1/2 (Keys 1981, eq. 15)."""
    s = np.abs(distance)
    near = (1.5 * s - 2.5) * s * s + 1.0
    far = ((-0.5 * s + 2.5) * s - 4.0) * s + 2.0
    return np.where(s < 1.0, near, np.where(s < 2.0, far, 0.0))
