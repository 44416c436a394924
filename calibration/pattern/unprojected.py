"""Recover a pattern as an image by least squares over all pixels of captures of known surfaces.

The model of a view is the pattern in the direction of its surface points, blurred, times a local
gain, minus the local mean. It is linear in the pattern. Conjugate gradients solve the normal
equations, and the model includes the imager's sampling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from starling.calibration.correlation import without_mean
from starling.calibration.pattern import cosine_image
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.views import Array, Modulation

_GAIN_PX = 12.0  # Sigma of the window of a local gain.
_GAIN_RANGE = (0.1, 3.0)
_FIRST_GAIN = 0.8
_RIDGE = 1e-2  # Ridge weight over the median information of a direction.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PlacedView:
    """Modulation of a view, with the directions of its pixels."""

    modulation: Modulation
    cosines: Array  # (h w, 2) nominal direction cosines; NaN where unknown.
    blur_px: float = 0.0  # Sigma of the imager's blur.
    gain: Array | None = None  # (h, w) local gain of the pattern; None before the first fit.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PatternImage:
    """A zero-mean pattern over direction cosines."""

    grid: Grid
    value: Array  # (h, w), with a standard deviation of about 1.
    sd: Array  # (h, w) standard error of `value`; inf without coverage.
    views: Array  # (h, w) coverage: number of views with a usable pixel in the direction.


def solve(
    placed: Sequence[PlacedView],
    grid: Grid,
    *,
    start: Array | None = None,
    rounds: int = 2,
    steps: int = 8,
) -> PatternImage:
    """Solve alternately for the pattern and the local gains of the views.

    Args:
        placed: at least one view.
        grid: grid of the pattern.
        start: (h, w) initial pattern; None starts from 0.
        rounds: number of rounds of gains and pattern.
        steps: steps of conjugate gradients per round.

    Returns:
        The pattern. Its standard error comes from the diagonal of the normal equations and is
        that of the blurred pattern. Detail that blur removes has a larger error: three times as
        large at a blur of 0.6 px.
    """
    value = np.zeros(grid.shape, np.float32) if start is None else start
    placed = [replace(view, cosines=grid.place(view.cosines)) for view in placed]
    information = np.zeros(grid.shape, np.float32)
    for _ in range(rounds):
        placed = [with_gain(view, value) for view in placed]
        information = _information(placed, grid)
        value = _conjugate_gradients(placed, value, information, steps)
    covered = information > 0
    sd = np.where(covered, 1 / np.sqrt(np.maximum(information, 1e-12)), np.inf)
    return PatternImage(
        grid=grid,
        value=value,
        sd=(sd * _excess(placed, value)).astype(np.float32),
        views=_coverage(placed, grid),
    )


def predict(view: PlacedView, value: Array) -> Array:
    """Predict a view's image of the pattern, minus its local mean (h, w)."""
    shape = view.modulation.value.shape
    light = np.zeros(shape[0] * shape[1], np.float32)
    cosine_image.read(value, view.cosines, light)
    return imaged(light.reshape(shape), view.blur_px)


def imaged(light: Array, blur_px: float) -> Array:
    """Blur light as an imager does and subtract the local mean (h, w)."""
    return without_mean(_blurred(light, blur_px))


def with_gain(view: PlacedView, value: Array) -> PlacedView:
    """Fit a view's local gain to a pattern; `cosines` are pixel coordinates of its grid."""
    return replace(view, gain=_gain(view, value))


def _blurred(image: Array, sigma_px: float) -> Array:
    if sigma_px == 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _gain(view: PlacedView, value: Array) -> Array:
    """Regress the view on the pattern in local windows."""
    if view.gain is None and not value.any():
        return np.full(view.modulation.value.shape, _FIRST_GAIN, np.float32)
    model = predict(view, value)
    usable = (view.modulation.weight > 0).astype(np.float32)

    def smooth(image: Array) -> Array:
        return np.asarray(cv2.GaussianBlur(image * usable, (0, 0), _GAIN_PX), np.float32)

    gain = smooth(model * view.modulation.value) / np.maximum(smooth(model * model), 1e-3)
    return np.clip(gain, *_GAIN_RANGE).astype(np.float32)


def _model(view: PlacedView, value: Array) -> Array:
    assert view.gain is not None
    return view.gain * predict(view, value)


def _transposed(view: PlacedView, residual: Array, total: Array) -> None:
    assert view.gain is not None
    gradient = without_mean(view.gain * view.modulation.weight * residual)
    cosine_image.add(total, view.cosines, _blurred(gradient, view.blur_px).ravel())


def _information(placed: Sequence[PlacedView], grid: Grid) -> Array:
    total = np.zeros(grid.shape, np.float32)
    for view in placed:
        assert view.gain is not None
        weight = view.modulation.weight * view.gain**2
        cosine_image.add(total, view.cosines, weight.ravel())
    return total


def _coverage(placed: Sequence[PlacedView], grid: Grid) -> Array:
    total = np.zeros(grid.shape, np.float32)
    for view in placed:
        counts = np.zeros(grid.shape, np.float32)
        cosine_image.add(
            counts, view.cosines, (view.modulation.weight > 0).astype(np.float32).ravel()
        )
        total += counts > 0
    return total


def _excess(placed: Sequence[PlacedView], value: Array) -> float:
    """Return the root mean square of the weighted residual; texture raises it above 1."""
    squares = weights = 0.0
    for view in placed:
        residual = view.modulation.value - _model(view, value)
        squares += float((view.modulation.weight * residual**2).sum())
        weights += float((view.modulation.weight > 0).sum())
    return float(np.sqrt(squares / max(weights, 1)))


def _conjugate_gradients(
    placed: Sequence[PlacedView], start: Array, information: Array, steps: int
) -> Array:
    covered = information > 0
    if not covered.any():
        return start
    ridge = np.float32(_RIDGE * np.median(information[covered]))

    def normal(value: Array) -> Array:
        return _sum(placed, lambda view: _model(view, value), start.shape) + ridge * value

    right_side = _sum(placed, lambda view: view.modulation.value, start.shape)
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
    placed: Sequence[PlacedView], make_image: Callable[[PlacedView], Array], shape: tuple[int, ...]
) -> Array:
    """Sum the transposed model over views, in two threads."""

    def half(first: int) -> Array:
        total = np.zeros(shape, np.float32)
        for view in placed[first::2]:
            _transposed(view, make_image(view), total)
        return total

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(half, (0, 1))
    return first + second


def _dot(first: Array, second: Array) -> float:
    return float(np.vdot(first.astype(np.float64), second))
