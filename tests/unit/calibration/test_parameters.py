"""The table of free parameters, and reading and setting them on a sensor."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration import parameters
from starling.patterns.errors import InputError
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

READABLE = [row.name for row in parameters.TABLE]


@given(st.sampled_from(READABLE), st.floats(-0.5, 0.5))
def test_values_are_read_back(name: str, share: float) -> None:
    sensor = presets.load("d435")
    (row,) = (row for row in parameters.TABLE if row.name == name)
    was = parameters.value(sensor, name)
    new = max(was + share * row.tolerance, 0.0) if "_deg" not in name else was + share
    changed = parameters.with_values(sensor, [(name, new)])
    assert parameters.value(changed, name) == pytest.approx(new, abs=1e-12)


def test_ratios_are_kept() -> None:
    sensor = with_values(presets.load("d435"), [("fy_px", 400.0)])
    wide = parameters.with_values(sensor, [("fx_px", 2 * sensor.fx_px), (parameters.FIELD, 0.5)])
    assert wide.fy_px == pytest.approx(800)
    before, after = (parameters.with_values(item, []).projector for item in (sensor, wide))
    from starling.sim.render.emission import half_tangents

    (x, y), (wide_x, wide_y) = half_tangents(before), half_tangents(after)
    assert wide_x == pytest.approx(0.5) and wide_y / wide_x == pytest.approx(y / x)


def test_groups_and_tolerances() -> None:
    sensor = presets.load("d435")
    rows = parameters.free(("focal", "baseline"), sensor)
    assert [row.name for row in rows] == ["baseline_m", "fx_px"]  # In the table's order.
    assert rows[1].tolerance == pytest.approx(0.01 * sensor.fx_px)
    image = with_values(sensor, [("projector.pattern", "dots.png")])
    (field,) = parameters.free(("field",), image)
    assert field.tolerance == pytest.approx(0.02 * parameters.value(image, parameters.FIELD))


def test_invalid_groups_are_refused() -> None:
    sensor = presets.load("d435")
    with pytest.raises(InputError, match="free must be a known name; got 'photometry'"):
        parameters.free(("photometry",), sensor)
    with pytest.raises(InputError, match="free must name a group; got none"):
        parameters.free((), sensor)
    with pytest.raises(InputError, match="free must not hold field"):
        parameters.free(("field",), sensor)
