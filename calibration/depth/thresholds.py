"""A matcher's thresholds and the scatter of disparity, found by trying them on simulated images.

Neither has a derivative: pixels pass a check or do not. All trials see the same images and the
same grains (common random numbers), so that they differ by the setting alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.calibration.depth import hole_places
from starling.calibration.depth.hole_places import Compared
from starling.sim import simulate
from starling.sim.console import progress
from starling.sim.effects import Parameter
from starling.sim.effects import setting as setting
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]
Column = NDArray[np.float64]

# Speckle differs in the two imagers and scales with the light, so its contrast means the same at
# any brightness; the effect of noise in electrons hangs on a level that depth does not show.
SCATTER = "laser_speckle"
CHECKS = ("uniqueness", "texture_threshold", "left_right_threshold")

_SCAN = (0.0, 0.25, 0.5, 0.75, 1.0)  # Of each threshold's range, before the search.
_TRIALS = 40  # At most, of the search.
_SIMPLEX = 0.12  # Its first side, of the range.
_BETTER = 0.98  # Of the score: what gains less leaves a threshold where it was.
_FINE = 0.01  # Of the range: a closer setting is not asked for.
_STEP = 0.08  # Of the range, of the differences that the uncertainty is from.
_BLIND = 0.6  # Of the range's own deviation: a parameter no better known is not told.
_RANGE_SD = 1 / np.sqrt(12)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Tuning:
    """What a search found; names are those of the table of effects."""

    names: tuple[str, ...]
    values: Column  # (n,) in the effects' units.
    covariance: NDArray[np.float64]  # (n, n); inf on the diagonal where nothing is told.
    sensor: Sensor  # With the values set.
    scores: tuple[float, ...]  # Mean squared difference in tolerances, after each stage.


class _Trial:
    """Readings of all scenes by one sensor; images are kept while only the matcher changes."""

    def __init__(self, scenes: Sequence[Compared], sensor: Sensor) -> None:
        self.scenes, self.sensor = scenes, sensor
        self._contrast: float | None = None
        self._pairs: list[simulate.Pair] = []
        self.tolerance = hole_places.tolerance(scenes, self._readings({}))

    def score(self, settings: dict[str, float]) -> float:
        """Mean squared difference from the device under some effects, in tolerances."""
        return float(np.mean((self.difference(settings) / self.tolerance) ** 2))

    def difference(self, settings: dict[str, float]) -> Column:
        """Compare the readings under some effects with the device's (7,)."""
        return hole_places.difference(self.scenes, self._readings(settings))

    def _readings(self, settings: dict[str, float]) -> list[Array]:
        sensor = setting.on_sensor(self.sensor, settings)
        contrast = sensor.projector.speckle_contrast
        if contrast != self._contrast:
            self._contrast = contrast
            self._pairs = [scene.twin.infrared(sensor) for scene in self.scenes]
        return [
            scene.twin.matched(pair, sensor)
            for scene, pair in zip(self.scenes, self._pairs, strict=True)
        ]


def tune(
    scenes: Sequence[Compared],
    sensor: Sensor,
    names: Sequence[str],
    *,
    track: progress.Progress = progress.silent,
) -> Tuning:
    """Fit the scatter and the thresholds of a sensor to the device's holes and scatter.

    The scatter's setting is the root where simulated and real scatter are equal (Brent); the
    thresholds minimise the score of `hole_places.difference` over a scan of each and a simplex
    (Nelder and Mead). Where both are free, the scatter is found before and after the thresholds.
    Rates by place are compared, not holes pixel by pixel: a score that asks for the same pixel
    prefers fewer holes wherever their exact place is chance.

    Args:
        scenes: rendered by the sensor's geometry.
        sensor: to start from.
        names: of `SCATTER` and `CHECKS`, those to find.
        track: wraps the stages.

    Raises:
        InputError: if the sensor has no such setting.

    Source of the method, moments of simulations: McFadden 1989, Econometrica 57(5).
    """
    trial = _Trial(scenes, sensor)
    found = {name: float(setting.value(_parameter(name), sensor) or 0.0) for name in names}
    checks = [name for name in CHECKS if name in names]
    stages = [stage for stage in ("scatter", "checks", "scatter again") if _due(stage, names)]
    scores = [trial.score(found)]
    for stage in track(stages, "search"):
        if stage == "checks":
            found |= _searched(trial, checks, found)
        else:
            found[SCATTER] = _scatter(trial, found)
        scores.append(trial.score(found))
    return Tuning(
        names=tuple(names),
        values=np.array([found[name] for name in names]),
        covariance=_covariance(trial, names, found),
        sensor=setting.on_sensor(sensor, found),
        scores=tuple(scores),
    )


def _due(stage: str, names: Sequence[str]) -> bool:
    checks, scatter = set(CHECKS) & set(names), SCATTER in names
    return bool({"scatter": scatter, "checks": checks, "scatter again": scatter and checks}[stage])


def _parameter(name: str) -> Parameter:
    return setting.parameter_of(name)[1]


def _value(name: str, share: float) -> float:
    """Setting at a share of its range: thresholds that start at 0 are told finer there."""
    parameter = _parameter(name)
    low, high = float(parameter.low or 0.0), float(parameter.high or 0.0)
    share = min(max(float(share), 0.0), 1.0)
    if name == SCATTER:
        return low + (high - low) * share
    return low * (high / low) ** share if low > 0 else high * share**2


def _share(name: str, value: float) -> float:
    """Invert `_value`, inside the range."""
    parameter = _parameter(name)
    low, high = float(parameter.low or 0.0), float(parameter.high or 0.0)
    value = min(max(value, low), high)
    if name == SCATTER:
        return (value - low) / (high - low)
    return float(np.log(value / low) / np.log(high / low)) if low > 0 else (value / high) ** 0.5


def _scatter(trial: _Trial, found: dict[str, float]) -> float:
    """Contrast at which the readings scatter as the device's, or the end of its range."""
    count = len(hole_places.SCATTERS)

    def excess(share: float) -> float:
        values = trial.difference({**found, SCATTER: _value(SCATTER, share)})
        weight = trial.tolerance[-count:] ** -2
        return float(values[-count:] @ weight / weight.sum())

    for end, sign in ((0.0, 1), (1.0, -1)):
        if sign * excess(end) >= 0:
            return _value(SCATTER, end)
    return _value(SCATTER, optimize.root_scalar(excess, bracket=(0.0, 1.0), xtol=_FINE).root)


def _searched(trial: _Trial, checks: Sequence[str], found: dict[str, float]) -> dict[str, float]:
    """Thresholds of the least score."""
    best = np.array([_share(name, found[name]) for name in checks])

    def score(shares: Column) -> float:
        settings = {name: _value(name, share) for name, share in zip(checks, shares, strict=True)}
        return trial.score({**found, **settings})

    least = score(best)
    for index in range(len(checks)):
        for share in _SCAN:
            tried = best.copy()
            tried[index] = share
            value = score(tried)
            if value < _BETTER * least:
                least, best = value, tried
    steps = np.where(best < 0.5, _SIMPLEX, -_SIMPLEX)
    simplex = np.vstack([best, best + np.diag(steps)])
    ended = optimize.minimize(
        score,
        best,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(checks),
        options={
            "initial_simplex": simplex,
            "maxfev": _TRIALS,
            "xatol": _FINE,
            "fatol": 1e-2 * max(least, 1e-6),
        },
    )
    shares = ended.x if ended.fun < _BETTER * least else best
    return {name: _value(name, share) for name, share in zip(checks, shares, strict=True)}


def _covariance(
    trial: _Trial, names: Sequence[str], found: dict[str, float]
) -> NDArray[np.float64]:
    """Linearise about what was found, with each range as what is known beforehand.

    A misfit beyond the tolerances widens it. What stays as wide as its range is not told.
    """
    at = np.array([_share(name, found[name]) for name in names])
    misfit = max(trial.score(found), 1.0)
    slopes = np.stack([_slope(trial, found, name) for name in names], axis=1)
    weighted = slopes / (trial.tolerance[:, None] * np.sqrt(misfit))
    spread = np.linalg.inv(weighted.T @ weighted + np.eye(len(names)) / _RANGE_SD**2)
    unit = np.array([_derivative(name, share) for name, share in zip(names, at, strict=True)])
    told = np.sqrt(np.diagonal(spread)) < _BLIND * _RANGE_SD
    covariance = np.where(np.outer(told, told), spread * np.outer(unit, unit), 0.0)
    covariance[np.diag_indices_from(covariance)] += np.where(told, 0.0, np.inf)
    return covariance


def _slope(trial: _Trial, found: dict[str, float], name: str) -> Column:
    """Change of what is compared with a parameter's share of its range."""
    share = _share(name, found[name])
    low, high = max(share - _STEP, 0.0), min(share + _STEP, 1.0)
    below, above = (trial.difference({**found, name: _value(name, end)}) for end in (low, high))
    return (above - below) / (high - low)


def _derivative(name: str, share: float) -> float:
    low, high = max(share - _STEP, 0.0), min(share + _STEP, 1.0)
    return (_value(name, high) - _value(name, low)) / (high - low)
