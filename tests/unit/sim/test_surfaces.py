"""Finish of surfaces and subsurface scattering on arrays, without a renderer."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.imaging import subsurface
from starling.sim.scene.scene import Body, Finish, Material, Mesh, Scene, Sun
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

SHAPE = (121, 181)


def _sensor() -> Sensor:
    intrinsics = {"fx_px": 600.0, "fy_px": 600.0, "cx_px": 90.0, "cy_px": 60.0}
    return dataclasses.replace(presets.load("d435"), width=SHAPE[1], height=SHAPE[0], **intrinsics)


def _scene(finish: Finish, names: tuple[str, ...] = ("wax", "wood")) -> Scene:
    mesh = Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.uint32))
    bodies = tuple(Body(name=name, mesh=mesh, material=Material(name=name)) for name in names)
    return Scene(name="two", bodies=bodies, finish=finish)


def _spread(
    light: np.ndarray, depth_m: np.ndarray, body: np.ndarray, sigma_m: float, pattern: str = "wax"
) -> np.ndarray:
    scene = _scene(Finish(of=pattern, subsurface_m=sigma_m))
    return subsurface.spread(light, depth_m, body, scene, _sensor())


def _flat(depth_m: float) -> tuple[np.ndarray, np.ndarray]:
    return np.full(SHAPE, depth_m, np.float32), np.ones(SHAPE, np.uint32)


def _point() -> np.ndarray:
    light = np.zeros(SHAPE, np.float32)
    light[SHAPE[0] // 2, SHAPE[1] // 2] = 1
    return light


def _sigma_px(image: np.ndarray) -> tuple[float, float]:
    """Standard deviation of an image's light along x and y."""
    rows, columns = np.indices(image.shape)
    total = image.sum(dtype=np.float64)
    spreads = []
    for axis in (columns, rows):
        mean = (image * axis).sum() / total
        spreads.append(float(np.sqrt((image * (axis - mean) ** 2).sum() / total)))
    return spreads[0], spreads[1]


@pytest.mark.parametrize("sigma_m", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("depth_m", [0.5, 0.73, 1.0])
def test_subsurface_sigma_is_a_length_on_the_surface(sigma_m: float, depth_m: float) -> None:
    """Sigma of the point response is sigma_m on the surface, so it halves in pixels at 2 z.

    Does not prove that real bodies spread light by a Gaussian. Slanted surfaces are not tested.
    """
    out = _spread(_point(), *_flat(depth_m), sigma_m)
    for sigma in _sigma_px(out):
        assert sigma * depth_m / 600 == pytest.approx(sigma_m, rel=0.02)


@pytest.mark.parametrize("sigma_m", [0.007, 0.009, 0.011])
def test_a_wide_spread_has_the_right_width_and_position(sigma_m: float) -> None:
    """Sigmas of 8 to 13 px, which are computed at a half or a third of the resolution.

    The mean over points is tested, since each is moved to the centre of its large pixel.
    """
    means, squares = [], []
    for step in range(6):
        light = np.zeros(SHAPE, np.float32)
        light[60 + step, 90 + step] = 1
        out = _spread(light, *_flat(0.5), sigma_m)
        rows, columns = np.indices(SHAPE) - step
        for away in (rows - 60, columns - 90):
            means.append((out * away).sum() / out.sum(dtype=np.float64))
            squares.append((out * away**2).sum() / out.sum(dtype=np.float64))
    assert np.mean(means[::2]) == pytest.approx(0, abs=0.05)
    assert np.mean(means[1::2]) == pytest.approx(0, abs=0.05)
    assert np.sqrt(np.mean(squares)) == pytest.approx(600 * sigma_m / 0.5, rel=0.003)


def test_an_interpolated_width_has_the_right_variance() -> None:
    """4.8 px, for a body with 4 px and 5.6 px in its corners."""
    depth_m, body = _flat(0.5)
    depth_m[0, 0], depth_m[-1, -1] = 0.6, 0.6 / 1.4
    for sigma in _sigma_px(_spread(_point(), depth_m, body, 0.004)):
        assert sigma == pytest.approx(4.8, rel=0.005)


def test_non_square_pixels_have_one_sigma_in_metres() -> None:
    sensor = dataclasses.replace(_sensor(), fy_px=450.0)
    scene = _scene(Finish(of="wax", subsurface_m=0.004))
    out = subsurface.spread(_point(), *_flat(0.5), scene, sensor)
    across, down = _sigma_px(out)
    assert across == pytest.approx(4.8, rel=0.02)
    assert down == pytest.approx(3.6, rel=0.02)


def test_the_gaussian_is_normalised_over_the_body_s_pixels() -> None:
    """Comparison with sums over all pairs of pixels of a small body at the image's border."""
    shape = (24, 30)
    rows, columns = np.indices(shape)
    body = np.where((rows - 6) ** 2 + (columns - 5) ** 2 < 130, 1, 2).astype(np.uint32)
    light = np.random.default_rng(3).random(shape).astype(np.float32)
    inside = body == 1
    positions = np.stack([rows[inside], columns[inside]], axis=1).astype(float)
    near = np.exp(-((positions[:, None] - positions[None]) ** 2).sum(axis=2) / (2 * 2.0**2))
    wanted = (near @ light[inside]) / near.sum(axis=1)
    depth_m = np.full(shape, 0.6, np.float32)
    out = _spread(light, depth_m, body, 0.002)
    np.testing.assert_allclose(out[inside], wanted, rtol=2e-3)
    assert np.array_equal(out[~inside], light[~inside])


def test_light_of_enclosed_bodies_is_not_spread() -> None:
    depth_m, body = _flat(0.7)
    body[50:70, 80:100] = 2
    light = (body == 2).astype(np.float32)
    before = light.copy()
    out = _spread(light, depth_m, body, 0.003)
    assert np.array_equal(out, before)
    assert np.array_equal(light, before)


def test_each_body_spreads_its_own_light() -> None:
    depth_m, body = _flat(0.7)
    body[:, 90:] = 2
    light = np.zeros(SHAPE, np.float32)
    light[60, 45] = light[60, 135] = 1
    before = light.copy()
    out = _spread(light, depth_m, body, 0.003, pattern="*")
    assert np.array_equal(light, before)  # The input is unchanged.
    np.testing.assert_allclose(out[:, :90], out[:, 90:180], atol=1e-7)
    assert out[60, 45] < 0.1


def test_small_sigmas_have_an_effect() -> None:
    """A tenth of a pixel: a hundredth of a dot's light leaves its pixel."""
    out = _spread(_point(), *_flat(0.6), 1e-4)
    assert 0.95 < out[60, 90] < 0.999


def test_sigma_follows_the_depth_within_one_image() -> None:
    """Of two points on one body, the one at twice the distance has half the blur in pixels.

    Intermediate widths are mixtures of two Gaussians. The test covers only their second moment.
    """
    depth_m, body = _flat(0.5)
    depth_m[:] = np.linspace(0.5, 1.0, SHAPE[1], dtype=np.float32)
    for column in (30, 90, 150):
        light = np.zeros(SHAPE, np.float32)
        light[60, column] = 1
        out = _spread(light, depth_m, body, 0.002)
        _, sigma = _sigma_px(out[:, column : column + 1])
        assert sigma == pytest.approx(600 * 0.002 / float(depth_m[60, column]), rel=0.05)


def test_light_is_kept_on_a_large_flat_body() -> None:
    """Light is conserved to 0.5 % away from the body's border.

    At a border the normalised Gaussian conserves the mean, not the sum. Real bodies lose light at
    their edges.
    """
    light = np.random.default_rng(0).gamma(0.2, 1.0, SHAPE).astype(np.float32)
    light[:30], light[-30:], light[:, :30], light[:, -30:] = 0, 0, 0, 0
    out = _spread(light, *_flat(0.8), 0.004)
    assert out.sum() == pytest.approx(light.sum(), rel=0.005)


@given(sigma_m=st.floats(1e-5, 0.05), level=st.floats(0.1, 10))
def test_even_light_stays_even(sigma_m: float, level: float) -> None:
    depth_m, body = _flat(0.7)
    out = _spread(np.full(SHAPE, level, np.float32), depth_m, body, sigma_m)
    np.testing.assert_allclose(out, level, rtol=1e-4)


def test_other_bodies_are_unchanged() -> None:
    light = np.random.default_rng(1).random(SHAPE).astype(np.float32)
    depth_m, body = _flat(0.7)
    body[:, :60] = 2
    body[:, 150:] = 0
    depth_m[:, 150:] = np.nan
    light[:, 60:] = 0
    out = _spread(light, depth_m, body, 0.005)
    assert np.array_equal(out[:, :60], light[:, :60])
    assert not out[:, 60:].any()


def test_neutral_returns_the_same_object() -> None:
    light, (depth_m, body) = _point(), _flat(0.7)
    assert _spread(light, depth_m, body, 0.0) is light
    assert _spread(light, depth_m, body, 0.003, pattern="stone*") is light
    assert _spread(light, depth_m, 2 * body, 0.003) is light


@pytest.mark.parametrize(
    ("pattern", "name"), [("*", "any thing"), ("cup ?", "cup 3"), ("cup", "cup")]
)
def test_finish_touches_by_name(pattern: str, name: str) -> None:
    assert Finish(of=pattern).touches(name)
    assert not Finish(of="cup ?").touches("cup 12")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("reflectance_scale", -0.1),
        ("reflectance_scale", 100.0),
        ("gloss", 1.5),
        ("metal", -0.1),
        ("transparency", 50.0),
        ("roughness", 0.0),
        ("subsurface_m", 2.0),
        ("of", ""),
    ],
)
def test_finish_refuses(field: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"finish.{field} must"):
        Finish(**{field: value})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"irradiance_w_m2": -1.0}, "sun.irradiance_w_m2 must"),
        ({"irradiance_w_m2": 5e4}, "sun.irradiance_w_m2 must"),
        ({"towards": (0.0, 0.0, 0.0)}, "length of sun.towards must"),
    ],
)
def test_sun_refuses(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Sun(**changes)


def test_light_does_not_spread_in_shapes_with_their_own_bsdf():
    """Bodies are numbered from 1, and so are the shapes of a Mitsuba XML, which has no bodies."""
    depth_m, body = _flat(1.0)
    scene = Scene(name="xml", shapes=(object(),), finish=Finish(subsurface_m=0.002))
    light = _point()
    assert subsurface.spread(light, depth_m, body, scene, _sensor()) is light
