"""Initial values of a geometry fit, from window matching over tens of pixels.

Dots repeat every few pixels, so a fit of images converges only from less than half that distance.
A window with a hundred dots is unique in its surroundings. Normalised correlation locates windows
of the predicted image in the observed one. Shifts that are consistent with one sensor separate
correct matches from chance.

Sources: normalised correlation: Lewis, Vision Interface 1995; hypotheses from few windows, scored
by all: Fischler and Bolles, CACM 24(6), 1981.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import parameters
from starling.calibration.geometry.residuals import ImagerView
from starling.calibration.parameters import DOT_BLUR, FIELD, CalibrationParameter
from starling.sim import randomness
from starling.sim.differentiable import image as differentiable_image
from starling.sim.differentiable import light as differentiable
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]

_WIDTH_PX = 640  # Larger images are downsampled to about this width.
# (window side, search range, distance of windows) of each round [px].
_ROUNDS = ((112, 24, 40), (72, 9, 32), (56, 5, 28))
_HYPOTHESES = 400
_SAMPLE = 5  # Windows of a hypothesis, in addition to the prior.
_SPREAD_PX = 0.7  # Standard deviation of correct shifts about the model.
_HIGH_PASS_PX = 5.0  # Sigma of the subtracted local mean.
_LOCAL_PX = 9.0  # Sigma of the local deviation.
_LEAST_SHARE = 0.5  # Minimum valid share of a window.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Windows:
    """Windows of all views: correlation by shift, and derivative of the shift by parameters."""

    maps: Array  # (n, 2 r + 1, 2 r + 1), y then x
    slopes: NDArray[np.float64]  # (n, 2, p) shift x, y [px] per tolerance of each parameter

    @property
    def reach(self) -> int:
        return self.maps.shape[1] // 2


@dataclass(frozen=True, kw_only=True, slots=True)
class GeometryStart:
    """Initial values of a fit."""

    step: NDArray[np.float64]  # Step of the free parameters, in tolerances.
    correlation: float  # Median correlation of the windows at their shifts; chance gives about 0.


def find_start(
    views: Sequence[ImagerView],
    sensor: Sensor,
    free: Sequence[CalibrationParameter],
    *,
    seed: int = 0,
) -> GeometryStart:
    """Estimate the free parameters so that the dots match to a fraction of a pixel.

    Args:
        views: views of all scenes.
        sensor: initial sensor, within its tolerances of the true one.
        free: free parameters; the dots' width is not changed.
        seed: random seed of the hypotheses.
    """
    step, correlation = np.zeros(len(free)), 0.0
    for number, (window, reach, stride) in enumerate(_ROUNDS):
        current = apply_step(sensor, free, step)
        windows = _match_windows(views, current, free, window=window, reach=reach, stride=stride)
        if len(windows.maps) == 0:
            break
        change = np.zeros(len(free))
        if number == 0:
            change = _best_hypothesis(windows, randomness.generator(seed, 0, "start", "windows"))
        step, correlation = _refine(windows, change, step)
    return GeometryStart(step=step, correlation=correlation)


def apply_step(
    sensor: Sensor, free: Sequence[CalibrationParameter], step: NDArray[np.float64]
) -> Sensor:
    """Apply a step in tolerances to the parameters; the step of the dot width is in variance."""
    values = []
    for row, change in zip(free, step, strict=True):
        old = parameters.value(sensor, row.name)
        if row.name == DOT_BLUR:
            new = float(np.sqrt(max(old**2 + change * row.tolerance**2, 0.0)))
        else:
            new = old + float(change) * row.tolerance
        values.append((row.name, new))
    return parameters.with_values(sensor, values)


def _match_windows(
    views: Sequence[ImagerView],
    sensor: Sensor,
    free: Sequence[CalibrationParameter],
    *,
    window: int,
    reach: int,
    stride: int,
) -> _Windows:
    maps, slopes = [], []
    for view in views:
        shrink = max(round(sensor.width / _WIDTH_PX), 1)
        traced = differentiable.trace(
            view.stage, sensor, view.side, subpixels=1, reference=view.reference
        )
        names = tuple(row.name for row in free if row.name != DOT_BLUR)
        flows = differentiable_image.flow(traced, names)
        light = _normalised(_downsampled(differentiable_image.form(traced).image, shrink))
        clear = _downsampled(traced.clear.astype(np.float32), shrink)
        light *= clear
        level = _normalised(_downsampled(view.level, shrink))
        flow = np.zeros((*clear.shape, 2, len(free)), np.float32)
        for number, row in enumerate(free):
            if row.name in flows:
                unit = row.tolerance / shrink
                if row.name == FIELD:
                    unit /= parameters.value(sensor, FIELD)
                flow[..., number] = _downsampled(flows[row.name], shrink) * unit
        height, width = clear.shape
        for top in range(reach, height - window - reach + 1, stride):
            for left in range(reach, width - window - reach + 1, stride):
                inside = slice(top, top + window), slice(left, left + window)
                weight = clear[inside]
                if weight.mean() < _LEAST_SHARE:
                    continue
                surroundings = level[
                    top - reach : top + window + reach, left - reach : left + window + reach
                ]
                maps.append(cv2.matchTemplate(surroundings, light[inside], cv2.TM_CCOEFF_NORMED))
                # The flow is 0 at invalid pixels.
                slopes.append(flow[inside].sum(axis=(0, 1)) / weight.sum())
    side = 2 * reach + 1
    return _Windows(
        maps=np.array(maps, np.float32).reshape(-1, side, side),
        slopes=np.array(slopes, np.float64).reshape(-1, 2, len(free)),
    )


def _best_hypothesis(windows: _Windows, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the step with the highest mean correlation over random hypotheses (RANSAC)."""
    flat = windows.maps.reshape(len(windows.maps), -1)
    peak = flat.argmax(axis=1)
    side, reach = 2 * windows.reach + 1, windows.reach
    shift = np.stack([peak % side, peak // side], axis=1) - float(reach)
    trust = np.maximum(flat.max(axis=1), 0) ** 2
    trust /= max(trust.sum(), 1e-12)
    best, highest_score = np.zeros(windows.slopes.shape[2]), -np.inf
    count = min(_SAMPLE, len(flat))
    for _ in range(_HYPOTHESES):
        chosen = rng.choice(len(flat), size=count, replace=False, p=_probabilities(trust, count))
        step = _solve_step(windows.slopes[chosen], shift[chosen], np.ones(count))
        score = float(_correlation_at(windows, step).mean())
        if score > highest_score:
            best, highest_score = step, score
    return best


def _probabilities(trust: NDArray[np.float64], count: int) -> NDArray[np.float64] | None:
    """Return the sampling probabilities of windows; None (uniform) if too few are nonzero."""
    return trust if np.count_nonzero(trust) > count else None


def _correlation_at(windows: _Windows, step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation (n,) of the windows at the shifts of a step; 0 out of range."""
    x, y = np.rint(windows.slopes @ step).astype(int).T + windows.reach
    side = 2 * windows.reach + 1
    inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
    correlation = windows.maps[np.arange(len(x)), np.clip(y, 0, side - 1), np.clip(x, 0, side - 1)]
    return np.where(inside, correlation, 0.0)


def _refine(
    windows: _Windows, step: NDArray[np.float64], previous: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Follow the windows' nearest peaks; return the total step and the median correlation."""
    height = np.zeros(1)
    for radius in (4, 3, 2, 2):
        shift, height = _nearest_peaks(windows, windows.slopes @ step, radius)
        weight = np.maximum(height, 0) ** 2
        for _ in range(10):
            distance = np.linalg.norm(shift - windows.slopes @ step, axis=1)
            robust = weight / (1 + (distance / _SPREAD_PX) ** 2)
            total_shift = shift + windows.slopes @ previous
            step = _solve_step(windows.slopes, total_shift, robust) - previous
    return previous + step, float(np.median(height))


def _nearest_peaks(
    windows: _Windows, shifts: NDArray[np.float64], radius: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sub-pixel position (n, 2) and height of each window's peak near a shift."""
    reach = windows.reach
    centres = np.clip(np.rint(shifts).astype(int), radius - reach + 1, reach - radius - 1) + reach
    shift, height = np.zeros(shifts.shape), np.zeros(len(shifts))
    for number, (x, y) in enumerate(centres):
        neighbourhood = windows.maps[
            number, y - radius : y + radius + 1, x - radius : x + radius + 1
        ]
        down, across = np.unravel_index(int(neighbourhood.argmax()), neighbourhood.shape)
        top, left = int(y - radius + down), int(x - radius + across)
        height[number] = neighbourhood.max()
        correlation = windows.maps[number]  # The peak is at least a pixel off the border.
        shift[number, 0] = (left - reach) + _vertex(
            correlation[top, left - 1], correlation[top, left], correlation[top, left + 1]
        )
        shift[number, 1] = (top - reach) + _vertex(
            correlation[top - 1, left], correlation[top, left], correlation[top + 1, left]
        )
    return shift, height


def _vertex(before: float, middle: float, after: float) -> float:
    """Return the peak of a parabola through three samples, from the middle one."""
    curvature = before - 2 * middle + after
    return (
        float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)) if curvature < -1e-9 else 0.0
    )


def _solve_step(
    slopes: NDArray[np.float64], shift: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the maximum a posteriori step: unit prior, shifts of deviation `_SPREAD_PX`."""
    root = np.sqrt(np.repeat(weight, 2)) / _SPREAD_PX
    matrix = slopes.reshape(-1, slopes.shape[2]) * root[:, None]
    normal = matrix.T @ matrix + np.eye(matrix.shape[1])
    return np.asarray(np.linalg.solve(normal, matrix.T @ (shift.ravel() * root)), np.float64)


def _normalised(image: Array) -> Array:
    """Return the high-passed image over its local deviation."""
    high = image - cv2.GaussianBlur(image, (0, 0), _HIGH_PASS_PX)
    local = cv2.GaussianBlur(high * high, (0, 0), _LOCAL_PX)
    floor = np.float32(0.05 * max(float(local.mean()), 1e-20))
    return np.asarray(high / np.sqrt(local + floor), np.float32)


def _downsampled(image: Array, factor: int) -> Array:
    if factor == 1:
        return image.astype(np.float32)
    height, width = (length // factor * factor for length in image.shape[:2])
    size = (width // factor, height // factor)
    small = cv2.resize(image[:height, :width], size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)
