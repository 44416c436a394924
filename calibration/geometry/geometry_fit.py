"""Fit the geometry of a sensor to captures of known surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration import parameters
from starling.calibration.geometry import residuals, start
from starling.calibration.geometry.residuals import ImagerView, PredictedView, ViewEquations
from starling.calibration.least_squares import solve, uncertainty
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.calibration.observation import Observation
from starling.calibration.parameters import DOT_BLUR, FIELD, CalibrationParameter
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.sensor.sensor import Sensor

_BLUR_SHARE = 1 / 640  # Sigma of the coarse stage's blur over the image width.
_LEAST_CORRELATION = 0.1  # Minimum correlation of the windows; below, no dots were found.


def fit_geometry(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    free: Sequence[str] = ("baseline", "focal", "centre", "projector"),
    subpixels: int = 2,
) -> Solution:
    """Fit pose and focal length of the imagers and the projector.

    Reflectance, ambient light, gain and falloff are eliminated locally and need not be correct.
    The result is the maximum a posteriori sensor. The prior is normal about the initial sensor,
    with the tolerances of `starling.calibration.parameters` as standard deviations.

    Args:
        observations: captured scenes with infrared images and a surface. Reference depth leaves a
            common scale undetermined (see `Solution.undetermined`); posed meshes determine it.
        sensor: initial sensor, with pattern, lens and electronics.
        free: groups of parameters (see `starling.calibration.parameters.GEOMETRY`).
        subpixels: n of the n x n sampling positions per pixel.

    Raises:
        InputError: if no scene is usable, a group is unknown, or the dots cannot be found.
        BackendError: if the renderer's variant is not differentiable.
    """
    rows = parameters.free(free, sensor)
    views = residuals.make_views(observations, sensor)
    initial = start.find_start(views, sensor, rows)
    if initial.correlation < _LEAST_CORRELATION:
        raise errors.refuse(
            "captures",
            "must show the sensor's dots",
            f"a correlation of {initial.correlation:.2f} with them",
            "Is the emitter on, and is it this sensor's pattern?",
        )
    fit = _GeometryFit(views, sensor, rows, subpixels)
    blur = _BLUR_SHARE * sensor.width
    solved = solve.solve(
        fit.equations(blur),
        fit.equations(0.0),
        initial.step,
        # Blur reduces the number of independent pixels by the Gaussian's effective area.
        inflation=max(4 * np.pi * blur**2, 1.0),
    )
    uncertainties = uncertainty.estimate(solved.equations)
    if FIELD in (row.name for row in rows) and not any(
        observation.metric for observation in observations
    ):
        uncertainties = uncertainty.with_open_scale(uncertainties, rows)
    return solution(solved, uncertainties, sensor, rows)


class _GeometryFit:
    """Views with the last rendering cached."""

    def __init__(
        self,
        views: Sequence[ImagerView],
        sensor: Sensor,
        free: Sequence[CalibrationParameter],
        subpixels: int,
    ) -> None:
        self._views, self._sensor, self._free = views, sensor, free
        self._subpixels = subpixels
        self._size = 0
        self._last: tuple[bytes, list[PredictedView]] = (b"", [])

    def equations(self, blur_px: float) -> solve.Evaluate[ViewEquations]:
        """Return the evaluation of the equations at one blur."""

        def evaluate(step: NDArray[np.float64], reference: ViewEquations | None) -> ViewEquations:
            predicted = self._predicted(step)
            weights = reference.variances if reference else (None,) * len(predicted)
            return ViewEquations.total(
                [
                    residuals.normal_equations(
                        view, size_px=self._size, blur_px=blur_px, variance=weight
                    )
                    for view, weight in zip(predicted, weights, strict=True)
                ]
            )

        return evaluate

    def _predicted(self, step: NDArray[np.float64]) -> list[PredictedView]:
        key = step.tobytes()
        if self._last[0] != key:
            sensor = start.apply_step(self._sensor, self._free, step)
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
    solved: solve.SolveResult[ViewEquations],
    uncertainties: Uncertainty,
    sensor: Sensor,
    free: Sequence[CalibrationParameter],
) -> Solution:
    """Convert the result of a fit to the units of the parameters.

    Args:
        solved: result in tolerances.
        uncertainties: uncertainty in tolerances.
        sensor: initial sensor.
        free: fitted parameters.
    """
    fitted = start.apply_step(sensor, free, solved.step)
    unit = np.array([_unit(row, fitted) for row in free])
    covariance = uncertainties.covariance * np.outer(unit, unit)
    deviation = np.sqrt(np.diagonal(covariance))
    shown = covariance.copy()
    shown[uncertainties.open, uncertainties.open] = np.inf
    estimates = tuple(
        Estimate(
            name=row.name,
            value=parameters.value(fitted, row.name),
            sd=float("inf") if is_open else float(sd),
            unit=row.unit,
            start=parameters.value(sensor, row.name),
        )
        for row, sd, is_open in zip(free, deviation, uncertainties.open, strict=True)
    )
    return Solution(
        estimates=estimates,
        covariance=shown,
        undetermined=uncertainty.sentences(uncertainties, free),
        cost=solved.costs,
        sensor=fitted,
        derived=derived(sensor, fitted, free, uncertainties, unit),
    )


def _unit(row: CalibrationParameter, sensor: Sensor) -> float:
    """Return the change of a parameter, in its unit, for a step of one tolerance."""
    if row.name != DOT_BLUR:
        return row.tolerance
    width = max(parameters.value(sensor, DOT_BLUR), row.tolerance / 10)
    return row.tolerance**2 / (2 * width)  # Steps are in the variance of the blur.


# Products that reference depth determines although it does not determine each factor: exponents.
_COMBINED = {
    "focal_baseline_px_m": ("px m", {"fx_px": 1, "baseline_m": 1}),
    "projector.position_x_over_baseline": ("1", {"projector.position_m.x": 1, "baseline_m": -1}),
    "focal_field_px": ("px", {"fx_px": 1, FIELD: 1}),
}


def derived(
    sensor: Sensor,
    fitted: Sensor,
    free: Sequence[CalibrationParameter],
    uncertainties: Uncertainty,
    unit: NDArray[np.float64],
) -> tuple[Estimate, ...]:
    """Compute products of parameters, with linearised standard deviations.

    Args:
        sensor: initial sensor.
        fitted: fitted sensor.
        free: fitted parameters; a product without a free factor is skipped.
        uncertainties: uncertainty in tolerances.
        unit: (p,) change of each parameter per tolerance, in its unit.
    """
    estimates = []
    for name, (text, powers) in _COMBINED.items():
        slope = np.zeros(len(free))
        value, initial = (_product(point, powers) for point in (fitted, sensor))
        for number, row in enumerate(free):
            if row.name in powers:
                power = powers[row.name]
                lowered = powers | {row.name: power - 1}
                slope[number] = power * _product(fitted, lowered) * unit[number]
        if slope.any():
            sd = float(np.sqrt(slope @ uncertainties.covariance @ slope))
            estimates.append(Estimate(name=name, value=value, sd=sd, unit=text, start=initial))
    return tuple(estimates)


def _product(sensor: Sensor, powers: dict[str, int]) -> float:
    return float(np.prod([parameters.value(sensor, key) ** power for key, power in powers.items()]))
