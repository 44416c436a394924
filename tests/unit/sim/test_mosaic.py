"""Mosaic of colour filters: interpolation, noise, colours of a scene, and neutral values."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim import simulate
from starling.sim.imaging import imager
from starling.sim.imaging.imager import converter, mosaic, noise
from starling.sim.imaging.noiseless import noiseless
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import materials, visible
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Imager, Sensor

RED = (0.6, 0.2, 0.1)
REC_601 = np.array([0.299, 0.587, 0.114])


def coloured(rgb: tuple[float, float, float] | None) -> Scene:
    scene = scenes.wall(1.0)
    material = dataclasses.replace(materials.named("wall paint"), rgb=rgb)
    bodies = tuple(dataclasses.replace(body, material=material) for body in scene.bodies)
    return dataclasses.replace(scene, bodies=bodies)


def small(**values: Any) -> Sensor:
    """A D405 of few pixels, of one exposure."""
    size = {"width": 64, "height": 48, "fx_px": 60.0, "fy_px": 60.0, "cx_px": 31.5, "cy_px": 23.5}
    edits = {**size, "imager.auto_exposure_level": 0.0, "imager.lens.vignetting": 0.0, **values}
    return with_values(presets.load("d405"), edits.items())


def test_luminance_is_that_of_opencvs_bilinear_interpolation() -> None:
    codes = np.random.default_rng(0).integers(0, 2**16, (33, 46)).astype(np.uint16)
    colours = cv2.cvtColor(codes, cv2.COLOR_BayerRGGB2RGB).astype(np.float64)
    light = mosaic.luminance(codes.astype(np.float32), "rggb")
    inner = (slice(1, -1), slice(1, -1))  # OpenCV repeats the inner pixels at the border.
    assert np.abs(light - colours @ REC_601)[inner].max() < 1.0


def test_grey_light_stays_and_no_mosaic_is_the_identity() -> None:
    grey = np.full((5, 7), 3.25, np.float32)
    np.testing.assert_allclose(mosaic.luminance(grey, "rggb"), grey, rtol=1e-6)
    assert mosaic.luminance(grey, "none") is grey
    assert mosaic.sample([grey]) is grey


def test_each_pixel_samples_the_light_behind_its_filter() -> None:
    red, green, blue = (np.full((3, 4), value, np.float32) for value in (1, 2, 3))
    expected = [[1, 2, 1, 2], [2, 3, 2, 3], [1, 2, 1, 2]]
    np.testing.assert_array_equal(mosaic.sample([red, green, blue]), expected)


@pytest.mark.parametrize("smoothing_px", [0.0, 0.6])
def test_noise_after_a_mosaic_has_the_stated_deviation(smoothing_px: float) -> None:
    """Electrons' noise, 16 bits of 1 electron each: the mean over pixels of the four positions."""
    part = Imager(
        mosaic="rggb",
        read_noise_e=40.0,
        shot_noise=1.0,
        full_well_e=65535.0,
        smoothing_px=smoothing_px,
    )
    light = np.full((400, 400), 9000.0, np.float32)
    read = imager.read_out(
        part, light, exposure_s=0.01, unit=0, side="left", seed=1, frame=0
    ).delivered
    stated = float(noise.noise_e(part, light, 0.01).mean())
    assert read.std() == pytest.approx(stated, rel=0.01)
    assert read.mean() == pytest.approx(9000.0, abs=1.0)


def test_luminance_reduces_noise_by_less_than_its_averages() -> None:
    """Shares by hand: a green pixel keeps 0.587 of itself, and half pairs of the others."""
    red, green, blue = REC_601
    at_green = green**2 + (red**2 + blue**2) / 2
    at_red = red**2 + green**2 / 4 + blue**2 / 4
    at_blue = blue**2 + green**2 / 4 + red**2 / 4
    expected = (2 * at_green + at_red + at_blue) / 4
    assert converter.pixel_variance_share("rggb", 0.0) == pytest.approx(expected, rel=1e-5)
    assert converter.pixel_variance_share("none", 0.7) == 1.0


def test_only_colours_in_visible_light_make_bands() -> None:
    scene = coloured(RED)
    red, _, blue = visible.bands(scene, small())
    assert (red.bodies[0].material.reflectance, blue.bodies[0].material.reflectance) == (0.6, 0.1)
    assert visible.bands(scene, small(**{"imager.mosaic": "none"})) == ()
    assert visible.bands(scene, small(**{"projector.wavelength_nm": 850.0})) == ()
    for grey in (None, (0.3, 0.3, 0.3)):
        assert visible.bands(coloured(grey), small()) == ()


def test_colour_images_make_bands() -> None:
    (body,) = scenes.wall(1.0).bodies
    mesh = dataclasses.replace(body.mesh, uv=np.zeros((len(body.mesh.vertices), 2), np.float32))
    pixels = np.array([[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]], np.float32)
    scene = dataclasses.replace(
        scenes.wall(1.0), bodies=(dataclasses.replace(body, mesh=mesh, colour=pixels),)
    )
    for channel, band in enumerate(visible.bands(scene, small())):
        texture = band.bodies[0].texture
        assert texture is not None
        np.testing.assert_array_equal(texture, pixels[..., channel])
    grey = dataclasses.replace(scene.bodies[0], colour=np.full_like(pixels, 0.5))
    assert visible.bands(dataclasses.replace(scene, bodies=(grey,)), small()) == ()


@pytest.mark.parametrize("rgb", [RED, (0.3, 0.3, 0.3)])
def test_the_image_of_a_colour_is_its_luminance(rgb: tuple[float, float, float]) -> None:
    """Rec. 601 of the colours, against the Rec. 709 of a monochrome imager."""
    scene = MitsubaScene(coloured(rgb))
    means = []
    for kind in ("none", "rggb"):
        sensor = small(**{"imager.mosaic": kind})
        layers = simulate.render_layers(scene, sensor, quality="draft")
        assert len(layers.left.bands) == (3 if kind == "rggb" and rgb == RED else 0)
        means.append(
            {side: image.mean() for side, image in noiseless(layers, scene.scene, sensor).items()}
        )
    expected = REC_601 @ rgb / (visible.LUMINANCE @ np.array(rgb))
    for side in ("left", "right"):
        assert means[1][side] / means[0][side] == pytest.approx(expected, rel=2e-3)


def test_a_monochrome_imager_ignores_bands() -> None:
    scene, sensor = MitsubaScene(coloured(RED)), small()
    layers = simulate.render_layers(scene, sensor, quality="draft")
    plain = small(**{"imager.mosaic": "none"})
    grey = simulate.render_layers(scene, plain, quality="draft")
    first, second = (simulate.infrared(each, scene.scene, plain) for each in (layers, grey))
    np.testing.assert_array_equal(first.left, second.left)


def test_unknown_mosaic_is_refused() -> None:
    with pytest.raises(InputError, match=r"imager.mosaic must be a known name; got 'bggr'"):
        Imager(mosaic="bggr")  # pyright: ignore[reportArgumentType]


def test_presets_have_a_mosaic_where_pixels_are_not_averaged() -> None:
    assert {name for name in presets.names() if presets.load(name).left.mosaic != "none"} == {
        *("d405", "zed-2i", "zed-mini"),
    }
    assert presets.load("d405", mode="640x480").right.mosaic == "rggb"
    assert presets.load("d405", mode="640x360").right.mosaic == "none"
    assert presets.load("oak-d-sr", mode="1280x800").left.mosaic == "rggb"
    assert presets.load("zed-mini", mode="672x376").left.mosaic == "rggb"
