"""Ambient light that surfaces block: `starling.sim.render.occlusion` against form factors.

**Rationale.** The visible share of an even sky next to a wall has a closed form.

**Expected behaviour.** Shares agree with it to a hundredth; blockers beyond the reach do nothing.

**What it does not prove.** Light that blockers reflect, which is not modelled.
"""

import dataclasses

import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.imaging import colour_picture
from starling.sim.render import direct, mitsuba_scene, occlusion
from starling.sim.render.rays import cameras
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

WHITE = Material(name="white", reflectance=0.6)
OPEN = Ambient(gradient=0.0)


def small() -> Sensor:
    base = dataclasses.replace(presets.load("d435"), width=160, height=120, cx_px=79.5, cy_px=59.5)
    return dataclasses.replace(base, fx_px=200.0, fy_px=200.0)


def corner(ambient: Ambient) -> mitsuba_scene.MitsubaScene:
    """A sheet 1 m ahead, and a wall of 1 m that stands on it at x = 0.3 m, towards the camera."""
    sheet = solids.body("sheet", solids.plane(8, 8), WHITE, frames.pose((0, 0, 1.0)))
    upright = frames.pose((0.3, 0, 0.5), (0, 90, 0))
    wall = solids.body("wall", solids.plane(1.0, 40), WHITE, upright)
    return mitsuba_scene.MitsubaScene(Scene(name="corner", bodies=(sheet, wall), ambient=ambient))


def sheet_places(sensor: Sensor) -> np.ndarray:
    """Distance of each column's point on the sheet to the wall [m]."""
    return 0.3 - (np.arange(sensor.width) - sensor.cx_px) / sensor.fx_px


def row_of(ambient: Ambient, samples: int) -> np.ndarray:
    camera, _ = cameras(small(), np.eye(4))
    return occlusion.sky_visibility(corner(ambient), camera, samples=samples)[60]


def test_a_wall_blocks_its_form_factor() -> None:
    """A wall of height H blocks (1 - a / sqrt(a^2 + H^2)) / 2 at the distance a.

    Source: Howell, A catalog of radiation heat transfer configuration factors, C-11 limit.
    """
    row = row_of(dataclasses.replace(OPEN, occlusion=1.0, reach_m=100.0), 1024)
    away = sheet_places(small())
    free = away > 0.02
    expected = 1 - (1 - away / np.sqrt(away**2 + 1)) / 2
    np.testing.assert_allclose(row[free], expected[free], atol=0.01)


def test_a_brighter_direction_weighs_more() -> None:
    """With a gradient towards the wall, its shadow is darker by the sky's radiance there."""
    even, tilted = (
        row_of(Ambient(gradient=gradient, up=(1, 0, 0), occlusion=1.0, reach_m=100.0), 256)
        for gradient in (0.0, 1.0)
    )
    assert (tilted[:100] < even[:100] - 0.01).all()


def test_surfaces_beyond_the_reach_do_not_block() -> None:
    row = row_of(dataclasses.replace(OPEN, occlusion=1.0, reach_m=0.2), 256)
    away = sheet_places(small())
    assert (row[away > 0.205] == 1).all()
    assert (row[(away > 0.02) & (away < 0.1)] < 1).all()


def test_the_layer_takes_a_share_of_the_shadow() -> None:
    """The ambient layer falls by occlusion (1 - V); all other layers keep their bits."""
    none, half, full = (
        direct.layers(corner(dataclasses.replace(OPEN, occlusion=share, reach_m=10.0)), small())
        for share in (0.0, 0.5, 1.0)
    )
    for side in ("left", "right"):
        without, some, most = (getattr(layers, side) for layers in (none, half, full))
        np.testing.assert_allclose(some.ambient, (without.ambient + most.ambient) / 2, rtol=1e-5)
        assert most.ambient.min() < 0.7 * without.ambient.max()
        assert np.array_equal(without.projector_direct, most.projector_direct)


def test_an_open_sheet_has_no_shadow() -> None:
    sheet = solids.body("sheet", solids.plane(8, 8), WHITE, frames.pose((0, 0, 1.0), (30, 20, 0)))
    with_sky, without = (
        direct.layers(
            mitsuba_scene.MitsubaScene(
                Scene(name="sheet", bodies=(sheet,), ambient=Ambient(occlusion=share))
            ),
            small(),
        ).left.ambient
        for share in (1.0, 0.0)
    )
    np.testing.assert_allclose(with_sky, without, rtol=1e-6)


def test_the_colour_picture_has_the_shadow() -> None:
    sensor = presets.load("d435")
    open_sky, blocked = (
        colour_picture.picture(
            corner(dataclasses.replace(OPEN, occlusion=share, reach_m=10.0)).scene, sensor
        )
        for share in (0.0, 1.0)
    )
    assert open_sky.std() < blocked.std() - 5


@pytest.mark.parametrize(("name", "value"), [("occlusion", 1.01), ("reach_m", 0.009)])
def test_values_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^ambient\.{name} must be in "):
        dataclasses.replace(OPEN, **{name: value})
