"""The effect table: every row can be set, has its stated neutral value, and is documented."""

from __future__ import annotations

import dataclasses
import datetime
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim import effects
from starling.sim.effects import Effect, Parameter, Stage, listing, setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import matcher, presets
from starling.sim.sensor.sensor import Colour, Sensor

ROWS = effects.table()
NUMBERS = [(row, parameter) for row in ROWS for parameter in row.parameters]


def _sensor() -> Sensor:
    """A sensor with every component, so that every row has a field to set."""
    colour = Colour(width=64, height=48, fx_px=60, fy_px=60, cx_px=32, cy_px=24)
    return dataclasses.replace(presets.load("d435"), colour=colour)


def _name(case: Any) -> str:
    return case.name if isinstance(case, Effect | Parameter) else str(case)


def test_table_has_enough_rows() -> None:
    assert len(ROWS) >= 35
    assert len({row.family for row in ROWS}) >= 20
    assert {row.stage for row in ROWS} == set(Stage)


def test_names_are_unique_and_the_order_is_the_chain() -> None:
    names = [row.name for row in ROWS]
    assert len(names) == len(set(names))
    order = list(Stage)
    places = [order.index(row.stage) for row in ROWS]
    assert places == sorted(places)


@pytest.mark.parametrize("row", ROWS, ids=_name)
def test_every_row_has_descriptions(row: Effect) -> None:
    assert row.family
    for text in (row.imitates, row.law, row.shows, row.source):
        assert len(text) > 5
    known = {effect.name for effect in ROWS} - {row.name}
    assert set(row.confused_with) <= known
    parameters = [parameter.name for parameter in row.parameters]
    assert parameters and len(parameters) == len(set(parameters))


@pytest.mark.parametrize(("row", "parameter"), NUMBERS, ids=_name)
def test_every_value_of_the_range_is_admitted(row: Effect, parameter: Parameter) -> None:
    sensor, scene = _sensor(), scenes.wall()
    if parameter.choices:
        values: list[Any] = list(parameter.choices)
        if parameter.low is not None:
            assert (parameter.low, parameter.high) == (min(values), max(values))
    else:
        assert parameter.low is not None and parameter.high is not None
        assert parameter.low < parameter.high
        values = [parameter.low, parameter.high]
    if parameter.neutral is not None:
        values.append(parameter.neutral)
    for value in values:
        moved = setting.apply(sensor, scene, {f"{row.name}.{parameter.name}": value})
        assert setting.value(parameter, *moved) == value


@pytest.mark.parametrize(("row", "parameter"), NUMBERS, ids=_name)
def test_a_unit_that_is_off_by_a_thousand_is_refused(row: Effect, parameter: Parameter) -> None:
    """Metres given in mm, watts in mW. A focus at several km is accepted as infinity."""
    if parameter.choices or parameter.high is None or parameter.name == "focus_m":
        return
    with pytest.raises(InputError, match=rf"^effect {row.name}\.{parameter.name}: .*must "):
        setting.apply(
            _sensor(), scenes.wall(), {f"{row.name}.{parameter.name}": 1000 * parameter.high}
        )


@pytest.mark.parametrize(("row", "parameter"), NUMBERS, ids=_name)
def test_every_row_changes_a_field(row: Effect, parameter: Parameter) -> None:
    sensor, scene = setting.ideal(_sensor(), scenes.wall())
    base = setting.value(parameter, sensor, scene)
    ends = parameter.choices or (parameter.low, parameter.high)
    changed = next(value for value in ends if value != base)
    assert changed is not None
    moved = setting.apply(sensor, scene, {f"{row.name}.{parameter.name}": changed})
    assert setting.value(parameter, *moved) != base
    assert (moved[0] != sensor) != (moved[1] is not scene)


@given(st.sets(st.sampled_from(NUMBERS), max_size=8))
def test_neutral_is_the_ideal_sensor(chosen: set[tuple[Effect, Parameter]]) -> None:
    """Setting any rows to neutral on an ideal camera leaves it as it is."""
    sensor, scene = setting.ideal(_sensor(), scenes.wall())
    settings = {
        f"{row.name}.{parameter.name}": value
        for row, parameter in chosen
        if (value := setting.neutral(parameter, sensor, scene)) is not None
    }
    moved = setting.apply(sensor, scene, settings)
    assert moved[0] == sensor
    for field in dataclasses.fields(scene):
        if field.name not in ("bodies", "world_from_left"):
            assert getattr(moved[1], field.name) == getattr(scene, field.name)


def test_settings_reach_both_imagers_one_component_and_the_scene() -> None:
    requested = {"lens_blur": 0.9, "motion.x": 0.2, "vertical_offset": 0.5}
    sensor, scene = setting.apply(presets.load("d435"), scenes.wall(), requested)
    assert sensor.left.lens.blur_px == sensor.right.lens.blur_px == 0.9
    assert (sensor.left.alignment.offset_y_px, sensor.right.alignment.offset_y_px) == (0, 0.5)
    assert scene.motion.velocity_m_s == (0.2, 0.0, 0.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lens_blur.": 1.0}, "parameter of lens_blur must be a known name; got ''"),
        ({"lens_blur": float("nan")}, "lens_blur.* must be a number; got nan. Its unit is px"),
        ({"speckle_filter": float("inf")}, "speckle_filter.* must be a number; got inf"),
        ({"registration": 0.5}, "registration.* must be one of 0, 1; got 0.5"),
        ({"prnu": 5.0, "lens_blur": 0.5}, r"^effect prnu: imager.prnu must be in \[0, 0.5\]"),
        ({"lens_blurr": 1.0}, "effect must be a known name; got 'lens_blurr'. Known: lens_blur, "),
        ({"lens_blur.siz": 1.0}, "parameter of lens_blur must be a known name"),
        ({"lens_blur": 400.0}, r"effect lens_blur: lens.blur_px must be in \[0, 20\]; got 400"),
        ({"lens_blur": "much"}, "lens_blur.* must be a number; got 'much'. Its unit is px"),
        ({"lens_blur": datetime.date(2026, 1, 2)}, "lens_blur.* must be a number; got datetime"),
        ({"lens_blur": 10**400}, "lens_blur.* must be a number; got 1000"),
        ({"lens_blur": True}, "lens_blur.* must be a number; got True"),
        ({"registration": [1]}, r"registration.* must be one of 0, 1; got \[1\]"),
        ({"hole_filling": "all"}, "hole_filling.* must be one of off, "),
        ({"quantisation": 9.0}, "quantisation.* must be one of 8, 10, 12, 16; got 9"),
        ({"speckle_filter": 20.5}, "must be a whole number; got 20.5"),
        (
            {"lens_blur": 0.5, "lens_blur." + effects.named("lens_blur").parameters[0].name: 0.6},
            r"must not set left.lens.blur_px to two values; got 0.5 and 0.6",
        ),
        ({"subsurface": 2.0}, r"finish.subsurface_m must be in \[0, 0.05\]; got 2.0. Give metres"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        setting.apply(_sensor(), scenes.wall(), settings)


def test_another_matcher_lacks_the_field() -> None:
    quick = dataclasses.replace(_sensor(), matcher=matcher.named("fast"))
    message = (
        r"effect presmooth needs a sensor with matcher.engine.presmooth_px; got d435 with "
        r"SemiGlobalBlock. Set matcher.setting to d4xx"
    )
    with pytest.raises(InputError, match=message):
        setting.apply(quick, scenes.wall(), {"presmooth": 1.0})
    (row,) = listing.rows(quick, "presmooth")
    assert row["parameters"][0]["neutral"] is None
    assert "neutral -, in the sensor -, sets" in listing.page([row])


@pytest.mark.parametrize("text", ["lens_blur", "=3", "lens_blur="])
def test_wrong_texts_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--effect must be NAME\[.PARAM\]=VALUE"):
        setting.parse([text])


def test_a_text_may_not_repeat() -> None:
    with pytest.raises(InputError, match="--effect must name a parameter once; got lens_blur"):
        setting.parse(["lens_blur=1", "lens_blur=2"])
    assert setting.parse(["lens_blur=1", "hole_filling=left"]) == {
        "lens_blur": 1.0,
        "hole_filling": "left",
    }


def test_listing_has_the_documented_keys() -> None:
    rows = json.loads(json.dumps(listing.rows(presets.load("d435"))))
    assert [row["name"] for row in rows] == [row.name for row in ROWS]
    for row in rows:
        assert {"name", "family", "stage", "rerender", "parameters", "source"} <= set(row)
        for parameter in row["parameters"]:
            assert {"name", "neutral", "low", "high", "unit"} <= set(parameter)
            assert parameter["neutral"] is not None
    lines = listing.text(rows).splitlines()
    assert all(any(line.startswith(f"{row.name} ") for line in lines) for row in ROWS)
    (blur,) = listing.rows(presets.load("d435"), "lens_blur")
    assert blur["parameters"][0]["value"] == 0.6
    page = listing.page([blur])
    assert "neutral 0, in the sensor 0.6, sets imager.lens.blur_px" in page
    assert page.startswith("lens_blur  (optics, family ") and "source: " in page
    assert np.all([len(line) <= 101 for line in page.splitlines()])
