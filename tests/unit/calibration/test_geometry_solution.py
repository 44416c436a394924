"""Conversion of a geometry fit to parameters: products, units, steps."""

from __future__ import annotations

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.geometry import geometry_fit, start
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.calibration.parameters import DOT_BLUR
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

SENSOR = with_values(presets.load("d415"), [(DOT_BLUR, 1.2)])
ROWS = parameters.free(("baseline", "focal", "projector"), SENSOR)


def product(sensor: Sensor, name: str) -> float:
    if name == "focal_baseline_px_m":
        return sensor.fx_px * sensor.baseline_m
    return sensor.projector.position_m[0] / sensor.baseline_m


@pytest.mark.parametrize("x_m", [0.029, 0.0])
def test_deviations_of_products_match_finite_differences(x_m: float) -> None:
    """The deviations of f b and of the projector's position over b match finite differences."""
    position = [x_m, *SENSOR.projector.position_m[1:]]
    edits = [("baseline_m", SENSOR.baseline_m * 1.02), ("projector.position_m", position)]
    fitted = with_values(SENSOR, edits)
    root = np.random.default_rng(0).standard_normal((len(ROWS), len(ROWS)))
    uncertainties = Uncertainty(
        covariance=root @ root.T,
        open=np.zeros(len(ROWS), bool),
        directions=np.zeros((0, len(ROWS))),
    )
    unit = np.array([row.tolerance for row in ROWS])
    derived = geometry_fit.derived(SENSOR, fitted, ROWS, uncertainties, unit)
    assert [estimate.name for estimate in derived] == [
        "focal_baseline_px_m",
        "projector.position_x_over_baseline",
        "focal_field_px",
    ]
    for estimate in derived[:2]:
        slope = [
            (
                product(start.apply_step(fitted, ROWS, 1e-3 * along), estimate.name)
                - product(start.apply_step(fitted, ROWS, -1e-3 * along), estimate.name)
            )
            / 2e-3
            for along in np.eye(len(ROWS))
        ]
        assert estimate.value == pytest.approx(product(fitted, estimate.name))
        assert estimate.start == pytest.approx(product(SENSOR, estimate.name))
        assert estimate.sd == pytest.approx(
            np.sqrt(slope @ uncertainties.covariance @ slope), rel=1e-3
        )


def test_the_step_of_dot_width_is_in_variance() -> None:
    """The deviation of the width follows at first order."""
    (row,) = parameters.free(("dots",), SENSOR)

    def width(step: float) -> float:
        return parameters.value(start.apply_step(SENSOR, (row,), np.array([step])), DOT_BLUR)

    assert width(1.0) == pytest.approx(np.hypot(1.2, row.tolerance))
    assert width(-9.0) == 0.0
    slope = (width(1e-4) - width(-1e-4)) / 2e-4
    assert geometry_fit._unit(row, SENSOR) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("peak", [-0.4, 0.0, 0.3])
def test_vertex_of_a_parabola(peak: float) -> None:
    before, centre, after = (5 - 2 * (x - peak) ** 2 for x in (-1, 0, 1))
    assert start._vertex(before, centre, after) == pytest.approx(peak)
    assert start._vertex(1.0, 1.0, 1.0) == 0.0
