"""A pattern as an image, from captures with known surfaces: least squares over all their pixels.

Each view is the pattern seen in the direction of its surface points, times a local gain, with the
neighbourhood's mean taken off. That is linear in the pattern: conjugate gradients on the normal
equations, with the imager's sampling inside the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from starling.calibration.pattern import cosine_image
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.modulation import Modulation, high_passed
from starling.calibration.pattern.views import Array

_GAIN_PX = 12.0  # Sigma over which a local gain is fitted.
_GAIN_RANGE = (0.1, 3.0)
_FIRST_GAIN = 0.8
_RIDGE = 1e-2  # Weight of the pattern's own size, over the median information a direction has.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Placed:
    """A view's modulation with the directions of its pixels."""

    modulation: Modulation
    cosines: Array  # (h w, 2) nominal direction cosines; NaN where unknown.
    blur_px: float = 0.0  # Sigma of the imager's own blur, which is not the pattern's.
    gain: Array | None = None  # (h, w) local gain of the pattern; None before any fit.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PatternImage:
    """A pattern about its mean, over direction cosines."""

    grid: Grid
    value: Array  # (h, w) of about unit deviation.
    sd: Array  # (h, w) standard deviation of `value`; inf where no view looked.
    views: Array  # (h, w) coverage: how many views' pixels looked there, by weight of the largest.


def solve(
    placed: Sequence[Placed],
    grid: Grid,
    *,
    start: Array | None = None,
    rounds: int = 2,
    steps: int = 8,
) -> PatternImage:
    """Solve for the pattern and the views' local gains in turn.

    Args:
        placed: views; at least one.
        grid: of the pattern.
        start: (h, w) pattern to begin from; nothing is known of it where None.
        rounds: of gains and pattern.
        steps: of conjugate gradients a round.

    Returns:
        The pattern, with the deviation that the views' noise leaves (the diagonal of the normal
        equations). It is that of the pattern as the imager blurs it: what the blur hides, from
        pixel to pixel, errs more, three times at a blur of 0.6 px.
    """
    value = np.zeros(grid.shape, np.float32) if start is None else start
    placed = [replace(one, cosines=grid.place(one.cosines)) for one in placed]
    information = np.zeros(grid.shape, np.float32)
    for _ in range(rounds):
        placed = [with_gain(one, value) for one in placed]
        information = _information(placed, grid)
        value = _conjugate_gradients(placed, value, information, steps)
    looked = information > 0
    sd = np.where(looked, 1 / np.sqrt(np.maximum(information, 1e-12)), np.inf)
    return PatternImage(
        grid=grid,
        value=value,
        sd=(sd * _excess(placed, value)).astype(np.float32),
        views=_coverage(placed, grid),
    )


def predicted(one: Placed, value: Array) -> Array:
    """The pattern as a view shows it, mean taken off (h, w)."""
    shape = one.modulation.value.shape
    out = np.zeros(shape[0] * shape[1], np.float32)
    cosine_image.read(value, one.cosines, out)
    return shown(out.reshape(shape), one.blur_px)


def shown(light: Array, blur_px: float) -> Array:
    """Light as an imager shows it, mean taken off (h, w)."""
    return high_passed(_blurred(light, blur_px))


def with_gain(one: Placed, value: Array) -> Placed:
    """Fit a view's local gain to a pattern; `cosines` are pixels of its grid."""
    return replace(one, gain=_gain(one, value))


def _blurred(image: Array, sigma_px: float) -> Array:
    if sigma_px == 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _gain(one: Placed, value: Array) -> Array:
    """Regress the view on the pattern, locally."""
    if one.gain is None and not value.any():
        return np.full(one.modulation.value.shape, _FIRST_GAIN, np.float32)
    model = predicted(one, value)
    seen = (one.modulation.weight > 0).astype(np.float32)

    def smooth(image: Array) -> Array:
        return np.asarray(cv2.GaussianBlur(image * seen, (0, 0), _GAIN_PX), np.float32)

    gain = smooth(model * one.modulation.value) / np.maximum(smooth(model * model), 1e-3)
    return np.clip(gain, *_GAIN_RANGE).astype(np.float32)


def _model(one: Placed, value: Array) -> Array:
    assert one.gain is not None
    return one.gain * predicted(one, value)


def _transposed(one: Placed, residual: Array, into: Array) -> None:
    assert one.gain is not None
    back = high_passed(one.gain * one.modulation.weight * residual)
    cosine_image.add(into, one.cosines, _blurred(back, one.blur_px).ravel())


def _information(placed: Sequence[Placed], grid: Grid) -> Array:
    total = np.zeros(grid.shape, np.float32)
    for one in placed:
        assert one.gain is not None
        weight = one.modulation.weight * one.gain**2
        cosine_image.add(total, one.cosines, weight.ravel())
    return total


def _coverage(placed: Sequence[Placed], grid: Grid) -> Array:
    total = np.zeros(grid.shape, np.float32)
    for one in placed:
        counts = np.zeros(grid.shape, np.float32)
        cosine_image.add(
            counts, one.cosines, (one.modulation.weight > 0).astype(np.float32).ravel()
        )
        total += counts > 0
    return total


def _excess(placed: Sequence[Placed], value: Array) -> float:
    """Root of the weighted mean squared residual: what texture adds to the noise."""
    squares = weights = 0.0
    for one in placed:
        residual = one.modulation.value - _model(one, value)
        squares += float((one.modulation.weight * residual**2).sum())
        weights += float((one.modulation.weight > 0).sum())
    return float(np.sqrt(squares / max(weights, 1)))


def _conjugate_gradients(
    placed: Sequence[Placed], start: Array, information: Array, steps: int
) -> Array:
    looked = information > 0
    if not looked.any():
        return start
    ridge = np.float32(_RIDGE * np.median(information[looked]))

    def normal(value: Array) -> Array:
        return _sum(placed, lambda one: _model(one, value), start.shape) + ridge * value

    right_side = _sum(placed, lambda one: one.modulation.value, start.shape)
    inverse = 1 / (information + ridge)
    value, residual = start, right_side - normal(start)
    direction = scaled = inverse * residual
    size = _dot(residual, scaled)
    for _ in range(steps):
        image = normal(direction)
        length = np.float32(size / max(_dot(direction, image), 1e-30))
        value = value + length * direction
        residual = residual - length * image
        scaled = inverse * residual
        size, before = _dot(residual, scaled), size
        direction = scaled + np.float32(size / max(before, 1e-30)) * direction
    return value


def _sum(
    placed: Sequence[Placed], image_of: Callable[[Placed], Array], shape: tuple[int, ...]
) -> Array:
    """Sum over views of the transposed model, in two threads."""

    def half(first: int) -> Array:
        total = np.zeros(shape, np.float32)
        for one in placed[first::2]:
            _transposed(one, image_of(one), total)
        return total

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(half, (0, 1))
    return first + second


def _dot(first: Array, second: Array) -> float:
    return float(np.vdot(first.astype(np.float64), second))
