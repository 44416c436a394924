"""Effects of the projector: its dots, falloff off the axis, power and flicker.

The ratio of dot light to uniform light is the pattern, free of surfaces and shadows. Its maxima in
the frame of the projector are the dots, equal for both imagers and all scenes. Between the dots the
pattern has a uniform background, which no effect on dots changes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import SIDES, LightView, SceneLight
from starling.diagnosis.validation.camera.psf import Image, Moments

Dots = Image  # (n, 2): directions of the dots, x / z and y / z in the projector's frame.

_EDGE_RAD = math.radians(45.0)  # Half of the 90 degree field, where both falloff laws agree.
_SECOND_PATTERN_PX = (5.0, 1.5)  # Shift of the second reflection of a plate (x, y) [px].
_BACKGROUND_PERCENTILE = 10.0  # Level between dots; render noise biases the minimum downwards.
_FLATTEN_PX = 0.7  # Gaussian sigma [px]; removes false maxima due to render noise.
_TALL = 1.2  # Least height of a dot over the mean of the pattern.
_APART_PX = 1.6  # Maxima from two views closer than this are the same dot [px].


def nearest_dot(view: LightView, dots: Dots) -> NDArray[np.intp]:
    """Return the index (h, w) of the dot nearest in direction to each pixel, -1 if none."""
    seen = np.isfinite(view.px) & np.isfinite(view.py)
    out = np.full(view.px.shape, -1, np.intp)
    if len(dots):
        out[seen] = KDTree(dots).query(np.stack([view.px[seen], view.py[seen]], 1))[1]
    return out


def background(view: LightView) -> Image:
    """Return the uniform background of the pattern (h, w): its level between dots, 0 if unlit."""
    whole, on = view.pattern(), view.lit()
    share = float(np.percentile(whole[on], _BACKGROUND_PERCENTILE)) if on.any() else 0.0
    return np.minimum(whole, share)


def gather(lights: Iterable[SceneLight], focal_px: float) -> Dots:
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
    return tangents


def dropped(view: LightView, dots: Dots, share: float, rng: np.random.Generator) -> LightView:
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
    dark = np.append(rng.random(len(dots)) < share, False)[nearest_dot(view, dots)]
    return view.with_pattern(np.where(dark, background(view), view.pattern()))


def shifted(
    view: LightView,
    dots: Dots,
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
    angles = rng.standard_normal((len(dots), 2)) * sigma_mrad * 1e-3
    # A small angle moves a tangent t by (1 + t^2).
    move_px = np.append(focal_px * angles * (1.0 + dots**2), [[0.0, 0.0]], axis=0)
    moved = move_px[nearest_dot(view, dots)]
    even = background(view)
    return view.with_pattern(even + _splat(view.pattern() - even, moved[..., 0], moved[..., 1]))


def widened(view: LightView, added: Moments) -> LightView:
    """Widen the dots in the image. Shading and shadows stay sharp.

    Args:
        view: Light of one imager.
        added: Variances added to the spot of each pixel.
    """
    if float(added[:2].max()) == 0.0:
        return view
    return view.with_pattern(psf.ellipses_within(view.pattern(), added, view.lit()))


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
    first = view.pattern() - even
    second = ndimage.shift(first, shift_px[::-1], order=1, mode="nearest")
    return view.with_pattern(even + (first + share * second) / (1.0 + share))


def project(view: LightView, strengths: Strengths, dots: Dots, draws: Draws) -> LightView:
    """Apply all projector effects to the laser light of one view.

    Args:
        view: Light at nominal power.
        strengths: Nominal camera and effect strengths.
        dots: Dots of the projector.
        draws: Random streams. The streams used here are equal for both imagers.

    Returns:
        The view with modified laser light, or `view` itself if no effect is active.
    """
    rng = draws.device_rng("projector/dropped")
    view = dropped(view, dots, strengths["dropped_dots"], rng)
    rng = draws.device_rng("projector/shifted")
    view = shifted(view, dots, strengths["shifted_dots"], strengths.nominal.fx_px, rng)
    view = doubled(view, strengths["doubled_dots"], _SECOND_PATTERN_PX)
    view = widened(view, added_variance(view, strengths))
    return _dim(view, strengths, flicker(strengths["flicker"], draws))


def added_variance(view: LightView, strengths: Strengths) -> Moments:
    """Return the variances that dot blur and dot defocus add to the dots.

    The variance is uniform over the field in direction cosines. A small change c of a cosine moves
    the tangent t of a ray by (1 + t^2)^(3/2) c radially and by sqrt(1 + t^2) c tangentially.
    """
    focus_m = strengths.nominal.projector_focus_m
    out_of_focus = strengths["dot_defocus"] * np.abs(1.0 / view.depth_m - 1.0 / focus_m)
    variance_mrad2 = strengths["dot_blur"] ** 2 + out_of_focus**2
    x, y = np.nan_to_num(view.px), np.nan_to_num(view.py)
    stretch = 1.0 + x**2 + y**2
    across = np.nan_to_num(variance_mrad2 * (1e-3 * strengths.nominal.fx_px) ** 2 * stretch)
    longer = across * (1.0 + stretch)
    return np.stack([across + longer * x**2, across + longer * y**2, longer * x * y])


def falloff(view: LightView, exponent: float) -> Image:
    """Return the relative power (h, w) of a projector that dims off its axis.

    A Gaussian beam exp(-k a^2), as of a single-mode emitter, replaces cos^n a of the effect page.
    Both agree on the axis and at the edge of the field, 45 degrees.
    """
    angle = np.arctan(np.hypot(np.nan_to_num(view.px), np.nan_to_num(view.py)))
    return np.exp(exponent * math.log(math.cos(_EDGE_RAD)) * (angle / _EDGE_RAD) ** 2)


def flicker(deviation: float, draws: Draws) -> float:
    """Draw the relative power of a frame: a gamma variate of mean 1, not a log-normal one."""
    if deviation == 0.0:
        return 1.0
    return float(draws.frame_rng("projector/flicker").gamma(deviation**-2, deviation**2))


def _dim(view: LightView, strengths: Strengths, power: float) -> LightView:
    exponent = strengths["projector_falloff"]
    laser = view.laser_e
    if exponent != 0.0:
        laser = laser * falloff(view, exponent)
    if strengths.is_active("projector_power"):
        laser = laser * (strengths["projector_power"] / strengths.nominal.power_w)
    if power != 1.0:
        laser = laser * power
    return view if laser is view.laser_e else dataclasses.replace(view, laser_e=laser)


def _detect(view: LightView) -> Image:
    """Directions (n, 2) of the dots in one view: the centroid of 3 x 3 pixels at each maximum."""
    on = view.lit()
    smooth = ndimage.gaussian_filter(view.pattern(), _FLATTEN_PX)
    tall = smooth > _TALL * np.mean(smooth, where=on) if on.any() else on
    top = (smooth == ndimage.maximum_filter(smooth, 3)) & tall & on
    weight = ndimage.uniform_filter(np.where(on, smooth, 0.0), 3)
    centres = [
        ndimage.uniform_filter(np.where(on, smooth * tangent, 0.0), 3)[top] / weight[top]
        for tangent in (view.px, view.py)
    ]
    return np.stack(centres, 1)


def _splat(values: Image, dx_px: Image, dy_px: Image) -> Image:
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


def _keys(distance: Image) -> Image:
    """Return the cubic convolution weight at a distance [px], a = -1/2 (Keys 1981, eq. 15)."""
    s = np.abs(distance)
    near = (1.5 * s - 2.5) * s * s + 1.0
    far = ((-0.5 * s + 2.5) * s - 4.0) * s + 2.0
    return np.where(s < 1.0, near, np.where(s < 2.0, far, 0.0))
