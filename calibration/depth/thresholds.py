"""Fit a matcher's thresholds and the scatter of disparity by search on simulated images.

The comparison has no derivative, because pixels pass a check or fail it. All trials use the same
images and speckle (common random numbers), so that they differ only by the setting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.calibration.depth import hole_places
from starling.calibration.depth.hole_places import ComparedScene
from starling.sim import simulate
from starling.sim.console import progress
from starling.sim.effects import Parameter, setting
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]
Column = NDArray[np.float64]

# Scatter is modelled by speckle. Speckle differs in the two imagers and scales with the light, so
# its contrast is independent of brightness. Electron noise would depend on the unknown level.
SCATTER = "laser_speckle"
CHECKS = ("uniqueness", "texture_threshold", "left_right_threshold")

# Lengths are in units of a setting's range.
_SCAN = (0.0, 0.25, 0.5, 0.75, 1.0)  # Grid of each threshold before the search.
_TRIALS = 40  # Maximum number of trials of the simplex search.
_SIMPLEX = 0.12  # Initial side of the simplex.
_BETTER = 0.98  # A threshold changes only if the score falls below this share of the lowest.
_FINE = 0.01  # Resolution of the search.
_STEP = 0.08  # Half step of the finite differences for the covariance.
_BLIND = 0.6  # Unidentifiable: standard deviation above this share of `_RANGE_SD`.
_RANGE_SD = 1 / np.sqrt(12)  # Standard deviation of a uniform distribution over the range.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Tuning:
    """Result of a search; names are effect names."""

    names: tuple[str, ...]
    values: Column  # (n,) in the effects' units.
    covariance: NDArray[np.float64]  # (n, n); inf on the diagonal of unidentifiable parameters.
    sensor: Sensor  # With the values set.
    scores: tuple[float, ...]  # Mean squared difference in tolerances, after each stage.


class _Trial:
    """Simulated readings of all scenes; images are reused while only the matcher changes."""

    def __init__(self, scenes: Sequence[ComparedScene], sensor: Sensor) -> None:
        self.scenes, self.sensor = scenes, sensor
        self._contrast: float | None = None
        self._pairs: list[simulate.InfraredPair] = []
        self.tolerance = hole_places.tolerance(scenes, self._readings({}))

    def score(self, settings: dict[str, float]) -> float:
        """Return the mean squared difference from the device, in tolerances."""
        return float(np.mean((self.difference(settings) / self.tolerance) ** 2))

    def difference(self, settings: dict[str, float]) -> Column:
        """Compare the readings under the given effects with the device (7,)."""
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
    scenes: Sequence[ComparedScene],
    sensor: Sensor,
    names: Sequence[str],
    *,
    track: progress.Progress = progress.silent,
) -> Tuning:
    """Fit scatter and thresholds of a sensor to the device's missing depth and scatter.

    Brent's method finds the setting at which simulated and device scatter are equal. The
    thresholds minimise the score of `hole_places.difference`: a scan of each, then a simplex
    search (Nelder and Mead). If both are free, the scatter is fitted before and after the
    thresholds. The score compares rates by place, not single pixels. A score by pixel would favour
    fewer no-depth pixels wherever their exact position is random.

    Args:
        scenes: scenes rendered with the sensor's geometry.
        sensor: initial sensor.
        names: names in `SCATTER` and `CHECKS` to fit.
        track: progress callback around the stages.

    Raises:
        InputError: if the sensor lacks a setting.

    Source of the method, moments of simulations: McFadden 1989, Econometrica 57(5).
    """
    trial = _Trial(scenes, sensor)
    settings = {name: float(setting.value(_parameter(name), sensor) or 0.0) for name in names}
    checks = [name for name in CHECKS if name in names]
    scatter = ["scatter"] if SCATTER in names else []
    stages = [*scatter, "checks", *scatter] if checks else scatter
    scores = [trial.score(settings)]
    for stage in track(stages, "search"):
        if stage == "checks":
            settings |= _search_checks(trial, checks, settings)
        else:
            settings[SCATTER] = _solve_scatter(trial, settings)
        scores.append(trial.score(settings))
    return Tuning(
        names=tuple(names),
        values=np.array([settings[name] for name in names]),
        covariance=_covariance(trial, names, settings),
        sensor=setting.on_sensor(sensor, settings),
        scores=tuple(scores),
    )


def _parameter(name: str) -> Parameter:
    return setting.parameter_of(name)[1]


def _value(name: str, share: float) -> float:
    """Return the setting at a share of its range; thresholds from 0 have finer steps near 0."""
    parameter = _parameter(name)
    low, high = float(parameter.low or 0.0), float(parameter.high or 0.0)
    share = min(max(float(share), 0.0), 1.0)
    if name == SCATTER:
        return low + (high - low) * share
    return low * (high / low) ** share if low > 0 else high * share**2


def _share(name: str, value: float) -> float:
    """Invert `_value`, limited to the range."""
    parameter = _parameter(name)
    low, high = float(parameter.low or 0.0), float(parameter.high or 0.0)
    value = min(max(value, low), high)
    if name == SCATTER:
        return (value - low) / (high - low)
    return float(np.log(value / low) / np.log(high / low)) if low > 0 else (value / high) ** 0.5


def _solve_scatter(trial: _Trial, settings: dict[str, float]) -> float:
    """Return the contrast that matches the device's scatter, or the nearest end of its range."""
    count = len(hole_places.SCATTERS)

    def excess(share: float) -> float:
        values = trial.difference({**settings, SCATTER: _value(SCATTER, share)})
        weight = trial.tolerance[-count:] ** -2
        return float(values[-count:] @ weight / weight.sum())

    for end, sign in ((0.0, 1), (1.0, -1)):
        if sign * excess(end) >= 0:
            return _value(SCATTER, end)
    return _value(SCATTER, optimize.root_scalar(excess, bracket=(0.0, 1.0), xtol=_FINE).root)


def _search_checks(
    trial: _Trial, checks: Sequence[str], initial: dict[str, float]
) -> dict[str, float]:
    """Return the thresholds with the lowest score."""
    best = np.array([_share(name, initial[name]) for name in checks])

    def score(shares: Column) -> float:
        settings = {name: _value(name, share) for name, share in zip(checks, shares, strict=True)}
        return trial.score({**initial, **settings})

    lowest_score = score(best)
    for index in range(len(checks)):
        for share in _SCAN:
            candidate = best.copy()
            candidate[index] = share
            value = score(candidate)
            if value < _BETTER * lowest_score:
                lowest_score, best = value, candidate
    steps = np.where(best < 0.5, _SIMPLEX, -_SIMPLEX)
    simplex = np.vstack([best, best + np.diag(steps)])
    result = optimize.minimize(
        score,
        best,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(checks),
        options={
            "initial_simplex": simplex,
            "maxfev": _TRIALS,
            "xatol": _FINE,
            "fatol": 1e-2 * max(lowest_score, 1e-6),
        },
    )
    shares = result.x if result.fun < _BETTER * lowest_score else best
    return {name: _value(name, share) for name, share in zip(checks, shares, strict=True)}


def _covariance(
    trial: _Trial, names: Sequence[str], settings: dict[str, float]
) -> NDArray[np.float64]:
    """Return the linearised covariance, with a uniform prior over each range.

    A misfit beyond the tolerances increases it. A parameter whose deviation stays close to that
    of its range is unidentifiable.
    """
    shares = np.array([_share(name, settings[name]) for name in names])
    misfit = max(trial.score(settings), 1.0)
    slopes = np.stack([_slope(trial, settings, name) for name in names], axis=1)
    weighted = slopes / (trial.tolerance[:, None] * np.sqrt(misfit))
    spread = np.linalg.inv(weighted.T @ weighted + np.eye(len(names)) / _RANGE_SD**2)
    unit = np.array([_derivative(name, share) for name, share in zip(names, shares, strict=True)])
    determined = np.sqrt(np.diagonal(spread)) < _BLIND * _RANGE_SD
    covariance = np.where(np.outer(determined, determined), spread * np.outer(unit, unit), 0.0)
    covariance[np.diag_indices_from(covariance)] += np.where(determined, 0.0, np.inf)
    return covariance


def _slope(trial: _Trial, settings: dict[str, float], name: str) -> Column:
    """Return the derivative of the difference by a parameter's share of its range."""
    share = _share(name, settings[name])
    low, high = max(share - _STEP, 0.0), min(share + _STEP, 1.0)
    below, above = (trial.difference({**settings, name: _value(name, end)}) for end in (low, high))
    return (above - below) / (high - low)


def _derivative(name: str, share: float) -> float:
    low, high = max(share - _STEP, 0.0), min(share + _STEP, 1.0)
    return (_value(name, high) - _value(name, low)) / (high - low)
