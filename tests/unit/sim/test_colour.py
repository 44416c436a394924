"""The colour camera's picture: colours, position, exposure, and invisible lights."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.geometry import frames
from starling.sim.imaging import colour_picture
from starling.sim.scene import materials, visible
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Material, ModelError, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Colour, Sensor

RGB = (0.6, 0.3, 0.1)


def _sensor(**changes) -> Sensor:
    camera = Colour(width=96, height=64, fx_px=80.0, fy_px=80.0, cx_px=48.0, cy_px=32.0)
    return dataclasses.replace(presets.load("d435"), colour=dataclasses.replace(camera, **changes))


def _wall(material: Material, *, texture: np.ndarray | None = None) -> Scene:
    sheet = solids.body("wall", solids.plane(6, 6), material, frames.pose((0, 0, 1.0)))
    mesh = dataclasses.replace(sheet.mesh, uv=np.zeros((4, 2), np.float32))
    return Scene(
        name="wall",
        bodies=(dataclasses.replace(sheet, mesh=mesh, texture=texture),),
        ambient=Ambient(irradiance_w_m2=0.2, gradient=0.0),
    )


def _linear(picture: np.ndarray) -> np.ndarray:
    value = picture / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def test_a_wall_has_the_colour_of_its_material() -> None:
    """Ratios of linear light are those of the reflectances, near infrared left out."""
    paint = Material(name="paint", reflectance=0.9, rgb=RGB)
    seen = _linear(colour_picture.picture(_wall(paint), _sensor())[32, 48])
    np.testing.assert_allclose(seen / seen[0], np.array(RGB) / RGB[0], rtol=0.02)


def test_a_material_without_colour_is_grey() -> None:
    seen = colour_picture.picture(_wall(Material(name="plain")), _sensor())
    assert (seen[..., 0] == seen[..., 1]).all() and (seen[..., 1] == seen[..., 2]).all()


def test_exposure_meets_its_level() -> None:
    for level in (0.3, 0.6):
        seen = colour_picture.picture(_wall(Material(name="plain")), _sensor(level=level))
        assert seen.mean() / 255 == pytest.approx(level, abs=0.04)


def test_projectors_do_not_light_the_picture() -> None:
    scene = _wall(Material(name="plain", rgb=RGB))
    lit = dataclasses.replace(scene, other_projector=Projector(power_w=1.0))
    strong = dataclasses.replace(
        _sensor(), projector=dataclasses.replace(_sensor().projector, power_w=5.0)
    )
    plain = colour_picture.picture(scene, _sensor())
    assert np.array_equal(colour_picture.picture(lit, _sensor()), plain)
    assert np.array_equal(colour_picture.picture(scene, strong), plain)


def test_a_texture_is_tinted() -> None:
    texture = np.full((32, 32), 0.25, np.float32)
    paint = Material(name="paint", reflectance=0.5, rgb=RGB)
    seen = _linear(colour_picture.picture(_wall(paint, texture=texture), _sensor())[32, 48])
    np.testing.assert_allclose(seen / seen[0], np.array(RGB) / RGB[0], rtol=0.02)


@pytest.mark.parametrize("scale", [1.0, 1.2])
def test_colour_camera_has_its_own_position(scale: float) -> None:
    """A patch on the left imager's axis is f t / z off the centre of the colour image."""
    patch = solids.body(
        "patch",
        solids.plane(0.1, 0.1),
        materials.named("paper"),
        frames.pose((0, 0, 0.9)),
    )
    scene = _wall(Material(name="dark", reflectance=0.02))
    scene = dataclasses.replace(
        scene, bodies=(*scene.bodies, patch), model_error=ModelError(scale=scale)
    )
    seen = colour_picture.picture(scene, _sensor(position_m=(-0.06, 0.0, 0.0)))[..., 1].astype(
        float
    )
    rows, columns = np.nonzero(seen > 0.5 * seen.max())
    assert columns.mean() == pytest.approx(48 + 80 * 0.06 / (0.9 * scale), abs=0.3)
    assert rows.mean() == pytest.approx(32, abs=0.3)


def test_a_sensor_without_colour_camera_is_refused() -> None:
    blind = dataclasses.replace(_sensor(), colour=None)
    with pytest.raises(InputError, match="colour must be given; got none in d435"):
        colour_picture.picture(_wall(Material(name="plain")), blind)


def _board(**changes) -> Scene:
    """A board that fills the picture; its uv run from 0 to 2, left to right and top to bottom."""
    sheet = solids.body("board", solids.plane(1.2, 0.8), PAINT, frames.pose((0, 0, 1.0)))
    uv = (sheet.mesh.vertices[:, :2] / np.float32([1.2, 0.8]) + np.float32(0.5)) * 2
    mesh = dataclasses.replace(sheet.mesh, uv=uv.astype(np.float32))
    body = dataclasses.replace(sheet, mesh=mesh, **changes)
    return Scene(name="board", bodies=(body,), ambient=Ambient(gradient=0.0))


PAINT = Material(name="paint", reflectance=0.9)
TILES = np.array([[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1]]], np.float32)


def test_a_colour_image_shows_in_the_picture_and_repeats() -> None:
    camera = _sensor(position_m=(0.0, 0.0, 0.0))
    dyed = _board(colour=np.repeat(np.repeat(TILES, 8, 0), 8, 1), repeats=True)
    seen = _linear(colour_picture.picture(dyed, camera)[32])
    for column, brightest in ((6, 0), (30, 1), (54, 0), (78, 1)):
        others = np.delete(seen[column], brightest)
        np.testing.assert_allclose(others / seen[column, brightest], 0.125, rtol=0.05)
    once = dataclasses.replace(dyed.bodies[0], repeats=False)
    edge = colour_picture.picture(dataclasses.replace(dyed, bodies=(once,)), camera)[32, 54]
    assert edge[1] > edge[0], "the edge of an image that does not repeat continues"


def test_a_colour_image_is_its_luminance_in_visible_light() -> None:
    dyed = _board(colour=TILES)
    sensor = presets.load("zed-2i")
    (body,) = visible.in_band(dyed, sensor).bodies
    assert body.texture is not None
    np.testing.assert_allclose(body.texture, TILES @ visible.LUMINANCE)
    assert visible.in_band(dyed, presets.load("d435")) is dyed
