"""Where a fit begins: dots found again by large windows, over tens of pixels.

Dots repeat every few pixels, so that a fit of images finds the right ones only from less than
half that distance. A window that holds a hundred of them is unlike its surroundings. Windows of
the predicted image are looked for in the observed one by normalised correlation; the shifts of
all windows must come from one sensor, which tells right places from chance.

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
from starling.calibration.geometry.residuals import View
from starling.calibration.parameters import DOT_BLUR, FIELD, Parameter
from starling.sim import randomness
from starling.sim.differentiable import image as differentiable_image
from starling.sim.differentiable import light as differentiable
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]

_WIDTH_PX = 640  # Larger images are matched at about this width.
# (window, how far it is looked for, their distance) [px] of each round.
_ROUNDS = ((112, 24, 40), (72, 9, 32), (56, 5, 28))
_HYPOTHESES = 400
_SAMPLE = 5  # Windows that make a hypothesis, with the tolerances behind them.
_SPREAD_PX = 0.7  # Of right windows' shifts about a model's.
_HIGH_PASS_PX = 5.0
_LOCAL_PX = 9.0
_LEAST_SHARE = 0.5  # Of a window that must show dots.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Windows:
    """Windows of all views: correlation at every shift, and how parameters would shift them."""

    maps: Array  # (n, 2 r + 1, 2 r + 1), y then x
    slopes: NDArray[np.float64]  # (n, 2, p) shift x, y [px] a tolerance of each parameter

    @property
    def reach(self) -> int:
        return self.maps.shape[1] // 2


@dataclass(frozen=True, kw_only=True, slots=True)
class Start:
    """Where a fit may begin."""

    step: NDArray[np.float64]  # Of the free parameters, in tolerances.
    correlation: float  # Median of the windows at their shifts: chance gives about 0.


def found(
    views: Sequence[View], sensor: Sensor, free: Sequence[Parameter], *, seed: int = 0
) -> Start:
    """Find the free parameters with which the dots lie right to a fraction of a pixel.

    Args:
        views: of all scenes.
        sensor: within its tolerances of the truth.
        free: the parameters; the dots' width stays.
        seed: of the hypotheses.
    """
    step, correlation = np.zeros(len(free)), 0.0
    for number, (window, reach, stride) in enumerate(_ROUNDS):
        now = stepped(sensor, free, step)
        windows = _matched(views, now, free, window=window, reach=reach, stride=stride)
        if len(windows.maps) == 0:
            break
        more = np.zeros(len(free))
        if number == 0:
            more = _best_hypothesis(windows, randomness.generator(seed, 0, "start", "windows"))
        step, correlation = _refined(windows, more, step)
    return Start(step=step, correlation=correlation)


def stepped(sensor: Sensor, free: Sequence[Parameter], step: NDArray[np.float64]) -> Sensor:
    """Move parameters by steps in units of their tolerances; the dots' width in variance."""
    values = []
    for row, part in zip(free, step, strict=True):
        now = parameters.value(sensor, row.name)
        if row.name == DOT_BLUR:
            new = float(np.sqrt(max(now**2 + part * row.tolerance**2, 0.0)))
        else:
            new = now + float(part) * row.tolerance
        values.append((row.name, new))
    return parameters.with_values(sensor, values)


def _matched(
    views: Sequence[View],
    sensor: Sensor,
    free: Sequence[Parameter],
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
        moving = tuple(row.name for row in free if row.name != DOT_BLUR)
        flows = differentiable_image.flow(traced, moving)
        light = _even(_shrunk(differentiable_image.formed(traced).image, shrink))
        clear = _shrunk(traced.clear.astype(np.float32), shrink)
        light *= clear
        level = _even(_shrunk(view.level, shrink))
        rate = np.zeros((*clear.shape, 2, len(free)), np.float32)
        for number, row in enumerate(free):
            if row.name in flows:
                unit = row.tolerance / shrink
                if row.name == FIELD:
                    unit /= parameters.value(sensor, FIELD)
                rate[..., number] = _shrunk(flows[row.name], shrink) * unit
        height, width = clear.shape
        for top in range(reach, height - window - reach + 1, stride):
            for left in range(reach, width - window - reach + 1, stride):
                inside = slice(top, top + window), slice(left, left + window)
                weight = clear[inside]
                if weight.mean() < _LEAST_SHARE:
                    continue
                around = level[
                    top - reach : top + window + reach, left - reach : left + window + reach
                ]
                maps.append(cv2.matchTemplate(around, light[inside], cv2.TM_CCOEFF_NORMED))
                # Where nothing is seen the rate is 0 already.
                slopes.append(rate[inside].sum(axis=(0, 1)) / weight.sum())
    side = 2 * reach + 1
    return _Windows(
        maps=np.array(maps, np.float32).reshape(-1, side, side),
        slopes=np.array(slopes, np.float64).reshape(-1, 2, len(free)),
    )


def _best_hypothesis(windows: _Windows, rng: np.random.Generator) -> NDArray[np.float64]:
    """Step of the parameters that most windows agree with."""
    flat = windows.maps.reshape(len(windows.maps), -1)
    peak = flat.argmax(axis=1)
    side, reach = 2 * windows.reach + 1, windows.reach
    shift = np.stack([peak % side, peak // side], axis=1) - float(reach)
    trust = np.maximum(flat.max(axis=1), 0) ** 2
    trust /= max(trust.sum(), 1e-12)
    best, most = np.zeros(windows.slopes.shape[2]), -np.inf
    count = min(_SAMPLE, len(flat))
    for _ in range(_HYPOTHESES):
        chosen = rng.choice(len(flat), size=count, replace=False, p=_spread(trust, count))
        step = _solved(windows.slopes[chosen], shift[chosen], np.ones(count))
        score = float(_looked_up(windows, step).mean())
        if score > most:
            best, most = step, score
    return best


def _spread(trust: NDArray[np.float64], count: int) -> NDArray[np.float64] | None:
    """Chances of windows; None, all alike, where too few have any."""
    return trust if np.count_nonzero(trust) > count else None


def _looked_up(windows: _Windows, step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Correlation (n,) of the windows at the shifts that a step gives; 0 beyond their reach."""
    x, y = np.rint(windows.slopes @ step).astype(int).T + windows.reach
    side = 2 * windows.reach + 1
    inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
    at = windows.maps[np.arange(len(x)), np.clip(y, 0, side - 1), np.clip(x, 0, side - 1)]
    return np.where(inside, at, 0.0)


def _refined(
    windows: _Windows, step: NDArray[np.float64], past: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Follow the windows' nearest peaks; the whole step, and the median correlation there."""
    height = np.zeros(1)
    for radius in (4, 3, 2, 2):
        shift, height = _nearest_peaks(windows, windows.slopes @ step, radius)
        weight = np.maximum(height, 0) ** 2
        for _ in range(10):
            off = np.linalg.norm(shift - windows.slopes @ step, axis=1)
            robust = weight / (1 + (off / _SPREAD_PX) ** 2)
            whole = shift + windows.slopes @ past
            step = _solved(windows.slopes, whole, robust) - past
    return past + step, float(np.median(height))


def _nearest_peaks(
    windows: _Windows, about: NDArray[np.float64], radius: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Highest correlation of each window near a shift: where (n, 2), to sub-pixels, and it."""
    reach = windows.reach
    place = np.clip(np.rint(about).astype(int), radius - reach + 1, reach - radius - 1) + reach
    shift, height = np.zeros(about.shape), np.zeros(len(about))
    for number, (x, y) in enumerate(place):
        near = windows.maps[number, y - radius : y + radius + 1, x - radius : x + radius + 1]
        down, across = np.unravel_index(int(near.argmax()), near.shape)
        top, left = int(y - radius + down), int(x - radius + across)
        height[number] = near.max()
        shift[number] = left - reach, top - reach
        if 0 < left < 2 * reach and 0 < top < 2 * reach:
            one = windows.maps[number]
            shift[number, 0] += _vertex(one[top, left - 1], one[top, left], one[top, left + 1])
            shift[number, 1] += _vertex(one[top - 1, left], one[top, left], one[top + 1, left])
    return shift, height


def _vertex(before: float, at: float, after: float) -> float:
    """Where a parabola through three samples peaks, from the middle one."""
    bend = before - 2 * at + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < -1e-9 else 0.0


def _solved(
    slopes: NDArray[np.float64], shift: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Most likely step: tolerances of one behind shifts of some deviation."""
    root = np.sqrt(np.repeat(weight, 2)) / _SPREAD_PX
    matrix = slopes.reshape(-1, slopes.shape[2]) * root[:, None]
    normal = matrix.T @ matrix + np.eye(matrix.shape[1])
    return np.asarray(np.linalg.solve(normal, matrix.T @ (shift.ravel() * root)), np.float64)


def _even(image: Array) -> Array:
    """High-passed image over its local deviation."""
    high = image - cv2.GaussianBlur(image, (0, 0), _HIGH_PASS_PX)
    local = cv2.GaussianBlur(high * high, (0, 0), _LOCAL_PX)
    floor = np.float32(0.05 * max(float(local.mean()), 1e-20))
    return np.asarray(high / np.sqrt(local + floor), np.float32)


def _shrunk(image: Array, factor: int) -> Array:
    if factor == 1:
        return image.astype(np.float32)
    height, width = (length // factor * factor for length in image.shape[:2])
    size = (width // factor, height // factor)
    small = cv2.resize(image[:height, :width], size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)
