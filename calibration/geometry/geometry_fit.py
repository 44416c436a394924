"""Fit the geometry of a sensor to captures of known surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration import parameters
from starling.calibration.geometry import residuals, start
from starling.calibration.geometry.residuals import Normal, Predicted, View
from starling.calibration.least_squares import solve, uncertainty
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.calibration.observation import Observation
from starling.calibration.parameters import DOT_BLUR, FIELD, Parameter
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.sensor.sensor import Sensor

_BLUR_SHARE = 1 / 640  # Of the image's width: sigma of the blur that the fit begins with.
_LEAST_CORRELATION = 0.1  # Of the windows at their places: below, no dots were found.


def fit_geometry(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    free: Sequence[str] = ("baseline", "focal", "centre", "projector"),
    subpixels: int = 2,
) -> Solution:
    """Fit where imagers and projector stand, look and focus.

    Reflectance, ambient light, gain and falloff are eliminated place by place and need not be
    right. The result is the most likely sensor given the captures and that a unit is within its
    tolerances (see `starling.calibration.parameters`) of the sensor given.

    Args:
        observations: captured scenes with infrared images and a surface: posed meshes, or
            reference depth, which leaves a common scale open (see `Solution.undetermined`).
        sensor: where to begin; pattern, lens and electronics are taken from it.
        free: groups of parameters (see `starling.calibration.parameters.GEOMETRY`).
        subpixels: n of the n x n positions in a pixel at which dots are sampled.

    Raises:
        InputError: no usable scene, an unknown group, or dots that cannot be found again.
        BackendError: in a variant that does not differentiate.
    """
    rows = parameters.free(free, sensor)
    views = residuals.views(observations, sensor)
    begun = start.found(views, sensor, rows)
    if begun.correlation < _LEAST_CORRELATION:
        raise errors.refuse(
            "captures",
            "must show the sensor's dots",
            f"a correlation of {begun.correlation:.2f} with them",
            "Is the emitter on, and is it this sensor's pattern?",
        )
    fit = _Fit(views, sensor, rows, subpixels)
    blur = _BLUR_SHARE * sensor.width
    solved = solve.solve(
        fit.equations(blur),
        fit.equations(0.0),
        begun.step,
        # As many fewer pixels are independent as the Gaussian's squared integral says.
        inflation=max(4 * np.pi * blur**2, 1.0),
    )
    found = uncertainty.of(solved.equations)
    if FIELD in (row.name for row in rows) and not any(seen.metric for seen in observations):
        found = uncertainty.scale_open(found, rows)
    return solution(solved, found, sensor, rows)


class _Fit:
    """Views, rendered once for each sensor that is tried."""

    def __init__(
        self,
        views: Sequence[View],
        sensor: Sensor,
        free: Sequence[Parameter],
        subpixels: int,
    ) -> None:
        self._views, self._sensor, self._free = views, sensor, free
        self._subpixels = subpixels
        self._size = 0
        self._last: tuple[bytes, list[Predicted]] = (b"", [])

    def equations(self, blur_px: float) -> solve.Evaluate[Normal]:
        """Equations at one blur."""

        def evaluate(step: NDArray[np.float64], like: Normal | None) -> Normal:
            predicted = self._predicted(step)
            weights = like.variances if like else (None,) * len(predicted)
            return Normal.total(
                [
                    residuals.normal(part, size_px=self._size, blur_px=blur_px, variance=weight)
                    for part, weight in zip(predicted, weights, strict=True)
                ]
            )

        return evaluate

    def _predicted(self, step: NDArray[np.float64]) -> list[Predicted]:
        key = step.tobytes()
        if self._last[0] != key:
            sensor = start.stepped(self._sensor, self._free, step)
            self._last = (
                key,
                [
                    residuals.predict(view, sensor, self._free, subpixels=self._subpixels)
                    for view in self._views
                ],
            )
            self._size = self._size or residuals.tile_px(self._last[1])
        return self._last[1]


def solution(
    solved: solve.Solved[Normal],
    found: Uncertainty,
    sensor: Sensor,
    free: Sequence[Parameter],
) -> Solution:
    """Put where a fit ended into the parameters' own units.

    Args:
        solved: in tolerances.
        found: how sure it is.
        sensor: where it began.
        free: its parameters.
    """
    ended = start.stepped(sensor, free, solved.step)
    unit = np.array([_unit(row, ended) for row in free])
    covariance = found.covariance * np.outer(unit, unit)
    deviation = np.sqrt(np.diagonal(covariance))
    shown = covariance.copy()
    shown[found.open, found.open] = np.inf
    estimates = tuple(
        Estimate(
            name=row.name,
            value=parameters.value(ended, row.name),
            sd=float("inf") if is_open else float(sd),
            unit=row.unit,
            start=parameters.value(sensor, row.name),
        )
        for row, sd, is_open in zip(free, deviation, found.open, strict=True)
    )
    return Solution(
        estimates=estimates,
        covariance=shown,
        undetermined=uncertainty.sentences(found, free),
        cost=solved.costs,
        sensor=ended,
        derived=derived(sensor, ended, free, found, unit),
    )


def _unit(row: Parameter, sensor: Sensor) -> float:
    """What a parameter moves by in its own unit for a step of one tolerance."""
    if row.name != DOT_BLUR:
        return row.tolerance
    width = max(parameters.value(sensor, DOT_BLUR), row.tolerance / 10)
    return row.tolerance**2 / (2 * width)  # Steps are in variance.


# Combinations that reference depth determines where it leaves their parts open: powers of each.
_COMBINED = {
    "focal_baseline_px_m": ("px m", {"fx_px": 1, "baseline_m": 1}),
    "projector.position_x_over_baseline": ("1", {"projector.position_m.x": 1, "baseline_m": -1}),
    "focal_field_px": ("px", {"fx_px": 1, FIELD: 1}),
}


def derived(
    sensor: Sensor,
    ended: Sensor,
    free: Sequence[Parameter],
    found: Uncertainty,
    unit: NDArray[np.float64],
) -> tuple[Estimate, ...]:
    """Combinations of parameters, with deviations by the first derivative.

    Args:
        sensor: where the fit began.
        ended: where it ended.
        free: its parameters; combinations of which none is free are left out.
        found: how sure they are, in tolerances.
        unit: (p,) of a tolerance of each.
    """
    out = []
    for name, (text, powers) in _COMBINED.items():
        slope = np.zeros(len(free))
        value, begun = (_product(where, powers) for where in (ended, sensor))
        for number, row in enumerate(free):
            if row.name in powers:
                power = powers[row.name]
                lowered = powers | {row.name: power - 1}
                slope[number] = power * _product(ended, lowered) * unit[number]
        if slope.any():
            sd = float(np.sqrt(slope @ found.covariance @ slope))
            out.append(Estimate(name=name, value=value, sd=sd, unit=text, start=begun))
    return tuple(out)


def _product(sensor: Sensor, powers: dict[str, int]) -> float:
    return float(np.prod([parameters.value(sensor, key) ** power for key, power in powers.items()]))
