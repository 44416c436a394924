"""Texture of surfaces on arrays, against its law."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.corrupt import Corruptor
from starling.sim.geometry import frames
from starling.sim.imaging import texture
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.scene import Body, Finish, Kind, Material, Mesh, ModelError, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

SHAPE = (240, 320)
MESH = Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.uint32))


def sensor() -> Sensor:
    intrinsics = {"fx_px": 640.0, "fy_px": 640.0, "cx_px": 160.0, "cy_px": 120.0}
    return dataclasses.replace(presets.load("d435"), width=SHAPE[1], height=SHAPE[0], **intrinsics)


def scene(
    contrast: float = 0.2,
    slope: float = 2.0,
    *,
    name: str = "wall",
    kind: Kind = "diffuse",
    **changes,
) -> Scene:
    finish = Finish(texture_contrast=contrast, texture_slope=slope)
    body = Body(name=name, mesh=MESH, material=Material(name="paint", kind=kind))
    return dataclasses.replace(Scene(name="wall", bodies=(body,), finish=finish), **changes)


def relative(seen: Scene, depth_m: float = 0.5, side: texture.Side = "left") -> np.ndarray:
    depth, body = np.full(SHAPE, depth_m, np.float32), np.ones(SHAPE, np.uint32)
    return texture.relative_reflectance(depth, body, seen, sensor(), side)


def view() -> ViewLayers:
    one = np.ones(SHAPE, np.float32)
    return ViewLayers(
        projector_direct=one,
        projector_indirect=one,
        ambient=one,
        other=one,
        depth_m=one,
        body=np.ones(SHAPE, np.uint32),
    )


def walls(slope: float = 2.0, count: int = 24) -> list[np.ndarray]:
    """Texture of several bodies, each of its own draw, less 1 and over the contrast."""
    return [(relative(scene(0.1, slope, name=f"wall {i}")) - 1) / 0.1 for i in range(count)]


def test_no_contrast_changes_nothing():
    seen = view()
    assert texture.textured(seen, scene(0.0), sensor(), "left") is seen


def test_all_light_is_multiplied():
    """Each layer of one brightness becomes the relative reflectance, and so do colour bands."""
    seen = dataclasses.replace(view(), bands=(view(),))
    out = texture.textured(seen, scene(), sensor(), "left")
    expected = relative(scene(), 1.0)
    for layers in (out, *out.bands):
        for light in (
            layers.projector_direct,
            layers.projector_indirect,
            layers.ambient,
            layers.other,
        ):
            assert np.array_equal(light, expected)


@pytest.mark.parametrize("slope", [1.0, 2.0, 3.0])
def test_contrast_and_slope_give_the_law_s_correlation(slope):
    """Autocorrelation at a distance r is the mean of sinc(2 r / wavelength) by variance.

    The mean over directions of waves in space gives it. The pixel's box is included as a Gaussian.
    Single draws scatter, so 24 bodies are averaged. Slanted surfaces are not tested.
    """
    depth_m, focal_px = 0.5, 640.0
    octaves = np.linspace(0, 7, 2000)
    wavelength_m = 0.128 * 2.0**-octaves
    variance = wavelength_m ** (slope - 2)
    variance /= variance.sum()
    pixel_m = depth_m / focal_px
    seen = variance * np.exp(-((2 * np.pi / wavelength_m * pixel_m) ** 2) / 12)
    textures = walls(slope)
    for shift_px in (0, 1, 3, 10, 30):
        expected = float(np.sum(seen * np.sinc(2 * shift_px * pixel_m / wavelength_m)))
        products = [t[:, : SHAPE[1] - shift_px] * t[:, shift_px:] for t in textures]
        assert np.mean(products) == pytest.approx(expected, abs=0.07)


def test_both_imagers_see_one_texture():
    """A wall's point lies at f b / z columns farther left in the right image."""
    device, depth_m = sensor(), 0.5
    shift_px = device.fx_px * device.true_baseline_m / depth_m
    depth_m *= shift_px / round(shift_px)  # A whole number of pixels.
    left, right = (relative(scene(), depth_m, side) for side in ("left", "right"))
    shift = round(shift_px)
    assert np.abs(left[:, shift:] - right[:, :-shift]).max() < 5e-3


def test_texture_stays_on_a_body_that_moves():
    """Camera and body that move together see the same texture; the body's name draws it."""
    moved = frames.pose((0.3, -0.2, 1.0), (10.0, 20.0, 30.0))
    still = scene()
    (body,) = still.bodies
    together = dataclasses.replace(
        still, world_from_left=moved, bodies=(dataclasses.replace(body, world_from_body=moved),)
    )
    assert np.abs(relative(together) - relative(still)).max() < 5e-3
    alone = dataclasses.replace(still, world_from_left=moved)
    assert np.corrcoef(relative(alone).ravel(), relative(still).ravel())[0, 1] < 0.5
    named = relative(scene(name="floor"))
    assert np.corrcoef(named.ravel(), relative(still).ravel())[0, 1] < 0.5


def test_texture_grows_with_the_model():
    """A model twice as large, twice as far, has the same image."""
    large = scene(model_error=ModelError(scale=2.0))
    assert np.abs(relative(large, 1.0) - relative(scene(), 0.5)).max() < 5e-3


@pytest.mark.parametrize("kind", ["mirror", "glass"])
def test_mirrors_and_glass_have_none(kind):
    assert (relative(scene(kind=kind)) == 1).all()


def test_pixels_without_a_surface_and_other_bodies_keep_their_light():
    depth, body = np.full(SHAPE, np.nan, np.float32), np.ones(SHAPE, np.uint32)
    depth[:, 100:] = 1
    body[:, 200:] = 0
    out = texture.relative_reflectance(depth, body, scene(), sensor(), "left")
    assert (out[:, :100] == 1).all() and (out[:, 200:] == 1).all()
    assert out[:, 100:200].std() > 0.05
    finish = dataclasses.replace(scene().finish, of="floor")
    assert (relative(dataclasses.replace(scene(), finish=finish)) == 1).all()


@pytest.mark.parametrize("key", ["texture_contrast", "texture_slope"])
def test_values_out_of_range_are_refused(key):
    with pytest.raises(InputError, match=rf"^finish.{key} must be in"):
        dataclasses.replace(Finish(), **{key: -0.1})


def test_a_batch_refuses_texture():
    pytest.importorskip("warp")
    device = sensor()
    matrix = np.array([[640.0, 0, 160], [0, 640, 120], [0, 0, 1]])
    with pytest.raises(InputError, match=r"^effect texture must be 0\.0 in a batch"):
        Corruptor(device, matrix, effects={"texture": 0.2}).batch(np.ones((1, *SHAPE), np.float32))
