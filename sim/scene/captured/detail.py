"""Reflectance in the detail of the infrared images: print, wood grain, keys, labels.

A base reflectance, smoothed over 12 px, is refined in frequency bands. Each imager's relative
residual against the modelled image is weighted by noise and by errors of the dots. The right
image's residual is brought into the left view. In each band a Wiener filter keeps the power that
both images share (texture), less the power that wrong dots would share. The model blurs as the
camera does, so that repeated refinement deconvolves.

A sensor with the camera's own dots has errors of their strengths and places only. With other dots,
they are removed from the images first (`room_light.remove_dots`), and the leak is what remains of
simulated dots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Mask
from starling.sim.imaging.imager.converter import pixel_variance_share, variance_share
from starling.sim.metrics import depth_edges
from starling.sim.scene.captured import room_light
from starling.sim.sensor.imager import Imager

_Floats = NDArray[np.floating[Any]]

LEVEL_PX = 12.0  # Sigma of the base's smoothing, and of local means and powers [px].
_SIGMAS_PX = (0.0, 0.8, 1.6, 3.2, 6.4, 12.8)  # Bands are differences of these Gaussians [px].
_PASSES = 3  # Refinements; each undoes more of the blur.
_BOX_PX = 0.5  # Sigma that pixel box and bilinear texture blur the reflectance by [px].
# Errors of a calibrated pattern in rooms 0060 and 1982 of `d415-faro`.
_STRENGTH = 0.25  # Standard deviation of a dot's light, relative.
_PLACE_PX = 0.5  # Standard deviation of a dot's place [px].
_LEAK = 2.0  # Margin of the leak of removed dots, as real dots are less even than simulated ones.
_RESIDUAL = (-1.0, 4.0)  # Range of relative residuals.
_STEP = (0.4, 2.5)  # Range of one refinement's factor.
_RANGE = (0.15, 4.0)  # Range of the refined reflectance over the base.
_REFLECTANCE = (0.003, 0.99)
_DARKEST = 0.05  # Least divisor, relative to the median.
_SEEN_PX = 1.5  # Largest disparity difference of one surface point in two views [px].
_ALONE = 0.05  # Smaller share of pixels that both imagers see: the power is one image's.
_UNWEIGHTED = np.float32(1e-4)  # Weight of hidden points, relative to the mean.
_TINY = 1e-9


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SeenView:
    """One imager's view of a captured scene, each (h, w), in ideal coordinates."""

    image: Image  # [DN above black]
    laser: Image  # Projector light on surfaces of one reflectance, before the lens.
    ambient: Image  # Ambient and other light on them, in the same unit.
    disparity_px: Image  # Of the modelled surface; NaN without one.
    imager: Imager


class _Residual(NamedTuple):
    value: _Floats  # Image minus model, over the model.
    weight: _Floats  # Inverse variance; 0 where the other imager or a depth edge hides the point.
    pattern: tuple[
        _Floats, _Floats, _Floats
    ]  # Relative light of dots, and its slopes along x and y.


class _Dots(NamedTuple):
    """Expected errors of the dots."""

    strength: float  # Relative.
    place_px: float
    remain: _Floats | None  # Remainder of removed simulated dots; None: the dots are known.


def refine(base: Image, views: Sequence[SeenView], *, dots_known: bool) -> Image:
    """Refine a smooth reflectance by the infrared images.

    Args:
        base: (h, w) reflectance in the left view, smoothed over `LEVEL_PX`.
        views: left view, and the right one if there is one.
        dots_known: whether the modelled dots are those of the images.

    Returns:
        (h, w) reflectance in the left view.
    """
    warps = _Warps(*(view.disparity_px for view in (views[0], views[-1])))
    dots = _Dots(_STRENGTH, _PLACE_PX, None)
    images: list[_Floats] = [view.image for view in views]
    if not dots_known:
        images = [np.maximum(room_light.remove_dots(view.image), 0) for view in views]
        dots = _Dots(0.0, 0.0, _remainder(base, views[0]))
    refined: Image = base
    gains: list[_Floats] | None = None
    for _ in range(_PASSES):
        residuals = [
            warps.residual(number, view, image, refined, dots)
            for number, (view, image) in enumerate(zip(views, images, strict=True))
        ]
        weight = np.sum([part.weight for part in residuals], axis=0, dtype=np.float32)
        weight = np.asarray(weight + _UNWEIGHTED * weight.mean(), np.float32)
        weighted = [part.value * part.weight for part in residuals]
        total = np.asarray(np.sum(weighted, axis=0), np.float32)
        bands = _bands(total / np.maximum(weight, _TINY), weight)
        if gains is None:
            gains = _gains(bands, residuals, views[0], dots)
        change = np.sum([gain * band for gain, band in zip(gains, bands, strict=True)], axis=0)
        refined = refined * np.clip(1 + change, *_STEP)
        refined = np.clip(refined, _RANGE[0] * base, _RANGE[1] * base)
        refined = np.clip(refined, *_REFLECTANCE).astype(np.float32)
    return refined


def in_right(image: Image, right_disparity_px: Image) -> Image:
    """Sample an image (h, w) of the left view at the surface points of the right view."""
    rows, columns = _places(image.shape)
    x = columns + np.nan_to_num(right_disparity_px)
    return _sampled(image, x, rows, cv2.INTER_LINEAR)


class _Warps:
    """Exchange between the two views by the surface's disparity."""

    def __init__(self, left_px: _Floats, right_px: _Floats) -> None:
        self._inner = tuple(~depth_edges(image) for image in (left_px, right_px))
        rows, columns = _places(left_px.shape)
        self._rows = rows
        self._in_right = columns - np.nan_to_num(left_px)
        self._in_left = columns + np.nan_to_num(right_px)
        opposite_px = _sampled(np.nan_to_num(right_px), self._in_right, rows, cv2.INTER_NEAREST)
        inside = (self._in_right >= 0) & (self._in_right <= left_px.shape[1] - 1)
        with np.errstate(invalid="ignore"):
            self._seen = inside & (np.abs(opposite_px - left_px) < _SEEN_PX)

    def residual(
        self, number: int, view: SeenView, image: _Floats, reflectance: _Floats, dots: _Dots
    ) -> _Residual:
        """Compare an image with its model, in the left view."""
        if number:
            reflectance = _sampled(reflectance, self._in_left, self._rows, cv2.INTER_LINEAR)
        compared = _compared(view, image, reflectance, self._inner[number], dots)
        if number == 0:
            return compared
        value = _sampled(compared.value, self._in_right, self._rows, cv2.INTER_CUBIC)
        weight = _sampled(compared.weight, self._in_right, self._rows, cv2.INTER_LINEAR)
        seen = self._seen & self._inner[0]
        return _Residual(value, np.where(seen, weight, np.float32(0)), compared.pattern)


def _compared(
    view: SeenView, image: _Floats, reflectance: _Floats, inner: Mask, dots: _Dots
) -> _Residual:
    laser, rest = _modelled(view, reflectance)
    if dots.remain is not None:  # The model keeps the light's local mean alone.
        spread = _modelled(view, np.ones_like(reflectance))
        rest = _blurred(reflectance, _blur_px(view.imager)) * _blurred(
            spread[0] + spread[1], LEVEL_PX
        )
        laser = np.zeros_like(rest)
    scale = _blurred(image, LEVEL_PX) / np.maximum(_blurred(laser + rest, LEVEL_PX), _TINY)
    laser, model = laser * scale, (laser + rest) * scale
    model = np.maximum(model, _DARKEST * np.median(model)).astype(np.float32)
    value = np.clip((image - model) / model, *_RESIDUAL).astype(np.float32)
    pattern = (
        laser / model,
        cv2.Sobel(laser, cv2.CV_32F, 1, 0, scale=1 / 8) / model,
        cv2.Sobel(laser, cv2.CV_32F, 0, 1, scale=1 / 8) / model,
    )
    variance = _noise_variance(view.imager, model) / model**2
    variance = variance + (dots.strength * pattern[0]) ** 2
    variance = variance + dots.place_px**2 * (pattern[1] ** 2 + pattern[2] ** 2)
    return _Residual(value, np.asarray(inner / variance, np.float32), pattern)


def _gains(
    bands: Sequence[_Floats], residuals: Sequence[_Residual], left: SeenView, dots: _Dots
) -> list[_Floats]:
    """Wiener gain of each band (h, w): texture over texture, wrong dots and noise."""
    level = np.maximum(_blurred(left.image, LEVEL_PX), 1)
    noise = _noise_variance(left.imager, level) / level**2
    known = (residuals[0].weight > 0).astype(np.float32)
    both = known * (residuals[-1].weight > 0)
    alone = _blurred(both, LEVEL_PX) < _ALONE
    split = [_bands(part.value, part.weight + np.float32(1e-6)) for part in residuals]
    if dots.remain is None:
        errors_of = [
            (scale, _bands(image, None))
            for scale, image in zip(
                (dots.strength, dots.place_px, dots.place_px), residuals[0].pattern, strict=True
            )
        ]
    else:
        errors_of = [(_LEAK**0.5, _bands(dots.remain, None))]
    gains = []
    for number, (band, share) in enumerate(zip(bands, _noise_shares(left.imager), strict=True)):
        power = _local(band * band, known)
        surface = np.maximum(power - noise * share, 0)
        if len(residuals) == 2:
            common = _local(split[0][number] * split[1][number], both)
            surface = np.where(alone, surface, np.maximum(common, 0))
            power = np.where(alone, power, _local(band * band, both))
        wrong = np.sum(
            [scale**2 * _local(part[number] ** 2, known) for scale, part in errors_of], axis=0
        )
        texture = np.maximum(surface - wrong, 0)
        rest = np.minimum(wrong, surface) + np.maximum(power - surface, 0.2 * noise * share)
        gains.append(np.asarray(texture / (texture + rest + _TINY), np.float32))
    return gains


def _bands(image: _Floats, weight: _Floats | None) -> list[_Floats]:
    """Split an image into bands, with weights of its pixels."""
    levels = [image]
    for sigma in _SIGMAS_PX[1:]:
        if weight is None:
            levels.append(_blurred(image, sigma))
        else:
            share = np.maximum(_blurred(weight, sigma), _TINY)
            levels.append(_blurred(image * weight, sigma) / share)
    return [fine - coarse for fine, coarse in pairwise(levels)]


def _noise_shares(imager: Imager) -> list[float]:
    """Share of the noise's variance in each band; noise is as smooth as the imager makes it."""
    white = np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32)
    smooth = _blurred(white, imager.smoothing_px)
    return [float(np.var(band)) for band in _bands(smooth / smooth.std(), None)]


def _remainder(base: _Floats, view: SeenView) -> _Floats:
    """What removing dots leaves of the modelled dots, over the local mean."""
    laser, rest = _modelled(view, base)
    model = np.asarray(laser + rest, np.float32)
    removed = np.maximum(room_light.remove_dots(model), 0)
    plain = _blurred(removed, LEVEL_PX)
    texture = base / np.maximum(_blurred(base, LEVEL_PX), 1e-3)
    remain = removed / np.maximum(plain, _DARKEST * np.median(plain)) - texture
    return np.asarray(np.clip(remain, -1, 2), np.float32)


def _modelled(view: SeenView, reflectance: _Floats) -> tuple[_Floats, _Floats]:
    """Images of the projector's light and of other light, blurred as by the camera."""
    reflectance, blur_px = _blurred(reflectance, _BOX_PX), _blur_px(view.imager)
    laser, rest = (_blurred(reflectance * light, blur_px) for light in (view.laser, view.ambient))
    return laser, rest


def _blur_px(imager: Imager) -> float:
    return float(np.hypot(imager.lens.blur_px, imager.smoothing_px))


def _noise_variance(imager: Imager, level_dn: _Floats) -> _Floats:
    """Variance of the noise [DN^2]: photons, readout, rounding."""
    gain = imager.dn_per_electron
    electrons = imager.shot_noise**2 * gain * level_dn + (imager.read_noise_e * gain) ** 2
    share = variance_share(imager.smoothing_px) ** 2
    share *= pixel_variance_share("none", imager.smoothing_px, imager.noise_correlation)
    return np.asarray(share * electrons + 1 / 12, np.float32)


def _local(image: _Floats, weight: _Floats) -> _Floats:
    mean = _blurred(image * weight, LEVEL_PX)
    return mean / np.maximum(_blurred(weight, LEVEL_PX), np.float32(0.02))


def _blurred(image: _Floats, sigma_px: float) -> _Floats:
    if sigma_px == 0:
        return image
    return np.asarray(cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), sigma_px), np.float32)


def _sampled(image: _Floats, x: _Floats, y: _Floats, mode: int) -> _Floats:
    image = np.asarray(image, np.float32)
    return np.asarray(cv2.remap(image, x, y, mode, borderMode=cv2.BORDER_REPLICATE), np.float32)


def _places(shape: tuple[int, ...]) -> tuple[Image, Image]:
    """Row and column of each pixel."""
    rows, columns = np.meshgrid(
        *(np.arange(side, dtype=np.float32) for side in shape), indexing="ij"
    )
    return rows, columns
