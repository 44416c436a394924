"""A fit of geometry in the parameters' own terms: combinations, units, and where it starts."""

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
def test_combinations_have_the_deviation_of_their_differences(x_m: float) -> None:
    """f b and the projector's place over b, by moving each parameter a little."""
    position = [x_m, *SENSOR.projector.position_m[1:]]
    edits = [("baseline_m", SENSOR.baseline_m * 1.02), ("projector.position_m", position)]
    ended = with_values(SENSOR, edits)
    root = np.random.default_rng(0).standard_normal((len(ROWS), len(ROWS)))
    found = Uncertainty(
        covariance=root @ root.T,
        open=np.zeros(len(ROWS), bool),
        directions=np.zeros((0, len(ROWS))),
    )
    unit = np.array([row.tolerance for row in ROWS])
    derived = geometry_fit.derived(SENSOR, ended, ROWS, found, unit)
    assert [one.name for one in derived] == [
        "focal_baseline_px_m",
        "projector.position_x_over_baseline",
        "focal_field_px",
    ]
    for one in derived[:2]:
        slope = [
            (
                product(start.stepped(ended, ROWS, 1e-3 * along), one.name)
                - product(start.stepped(ended, ROWS, -1e-3 * along), one.name)
            )
            / 2e-3
            for along in np.eye(len(ROWS))
        ]
        assert one.value == pytest.approx(product(ended, one.name))
        assert one.start == pytest.approx(product(SENSOR, one.name))
        assert one.sd == pytest.approx(np.sqrt(slope @ found.covariance @ slope), rel=1e-3)


def test_a_step_of_the_dots_width_is_one_of_its_variance() -> None:
    """And the width's own deviation is what that makes at first order."""
    (row,) = parameters.free(("dots",), SENSOR)

    def width(step: float) -> float:
        return parameters.value(start.stepped(SENSOR, (row,), np.array([step])), DOT_BLUR)

    assert width(1.0) == pytest.approx(np.hypot(1.2, row.tolerance))
    assert width(-9.0) == 0.0
    slope = (width(1e-4) - width(-1e-4)) / 2e-4
    assert geometry_fit._unit(row, SENSOR) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("peak", [-0.4, 0.0, 0.3])
def test_a_parabola_s_vertex_is_where_it_is_highest(peak: float) -> None:
    before, at, after = (5 - 2 * (x - peak) ** 2 for x in (-1, 0, 1))
    assert start._vertex(before, at, after) == pytest.approx(peak)
    assert start._vertex(1.0, 1.0, 1.0) == 0.0
