"""Light from surfaces: ambient light, subsurface scattering, second projector, exposure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.validation.camera import scene_light
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.scene_light import ReceivedLight


def _leave(
    light: SceneLight, camera: Nominal, side: str = "left", **values: float
) -> ReceivedLight:
    strengths = Strengths(nominal=camera, values=values)
    return scene_light.leave(light.view(side), strengths)


def test_ambient_light_is_per_watt(light: SceneLight, camera: Nominal) -> None:
    received = _leave(light, camera, ambient=2.0)
    np.testing.assert_allclose(received.rest_e, 2.0 * light.left.ambient_e)
    assert not _leave(light, camera, ambient=0.0).rest_e.any()


def test_normals_of_a_leaning_wall(light: SceneLight, camera: Nominal) -> None:
    """Rationale: 1 / z = 1 + 0.4 y / z is the plane z + 0.4 y = 1 with normal (0, -0.4, -1)."""
    up = scene_light.facing_up(light.left, camera)
    wall, box = light.left.body == 1, light.left.body == 2
    np.testing.assert_allclose(up[wall], 0.4 / np.hypot(0.4, 1.0), rtol=1e-6)
    np.testing.assert_allclose(up[box], 0.0, atol=1e-9)
    assert not up[light.left.body == 0].any()


def test_no_surface_has_no_normal(light: SceneLight, camera: Nominal) -> None:
    sky = dataclasses.replace(light.left, body=np.zeros(camera.shape, np.uint32))
    assert not scene_light.facing_up(sky, camera).any()


@pytest.mark.parametrize("gradient", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("rendered", [0.0, 0.5])
def test_gradient_follows_the_normal(
    gradient: float, rendered: float, light: SceneLight, camera: Nominal
) -> None:
    """Law: the light scales by 1 + 2/3 g n . up over the same term of the rendered gradient."""
    nominal_camera = dataclasses.replace(camera, ambient_gradient=rendered)
    wall, box = light.left.body == 1, light.left.body == 2

    def law(up: float) -> float:
        return (1.0 + 2.0 / 3.0 * gradient * up) / (1.0 + 2.0 / 3.0 * rendered * up)

    as_is = _leave(light, nominal_camera).rest_e
    tilted = _leave(light, nominal_camera, ambient_gradient=gradient).rest_e
    np.testing.assert_allclose(tilted[wall], as_is[wall] * law(0.4 / np.hypot(0.4, 1.0)), rtol=1e-6)
    np.testing.assert_allclose(tilted[box], as_is[box], rtol=1e-9)
    leaning = dataclasses.replace(light.left, up=np.array([0.0, 0.0, -1.0]))
    towards = dataclasses.replace(light, left=leaning)
    tilted = _leave(towards, nominal_camera, ambient_gradient=gradient).rest_e
    np.testing.assert_allclose(tilted[box], as_is[box] * law(1.0), rtol=1e-6)


def test_the_rendered_gradient_is_the_identity(light: SceneLight, camera: Nominal) -> None:
    for g0 in (0.0, 0.3, 0.5):
        nominal_camera = dataclasses.replace(camera, ambient_gradient=g0)
        for side in ("left", "right"):
            same = _leave(light, nominal_camera, side, ambient_gradient=g0).rest_e
            np.testing.assert_array_equal(same, camera.ambient_w_m2 * light.view(side).ambient_e)


def test_second_projector_and_exposure_scale_the_light(light: SceneLight, camera: Nominal) -> None:
    plain = _leave(light, camera)
    more = _leave(light, camera, second_projector=0.2)
    np.testing.assert_allclose(more.rest_e - plain.rest_e, 0.2 * light.left.other_e, atol=1e-9)
    longer = _leave(light, camera, exposure=0.03)
    np.testing.assert_allclose(longer.laser_e, 3.0 * plain.laser_e)
    np.testing.assert_allclose(longer.rest_e, 3.0 * plain.rest_e)


@pytest.mark.parametrize("depth_m", [0.5, 1.0])
def test_subsurface_scattering_has_a_metric_width(
    depth_m: float, light: SceneLight, camera: Nominal
) -> None:
    """Law: the variance in pixels is (fx sigma / z)^2, so near bodies blur more."""
    laser = np.zeros(camera.shape)
    laser[31, 47] = 100.0
    view = dataclasses.replace(
        light.left,
        laser_e=laser,
        even_e=np.ones(camera.shape),
        depth_m=np.full(camera.shape, depth_m),
        body=np.ones(camera.shape, np.uint32),
        px=np.zeros(camera.shape),
    )
    values = {"subsurface": 0.01}
    out = scene_light.leave(view, Strengths(nominal=camera, values=values)).laser_e
    offset = np.arange(camera.width) - 47
    variance = (out.sum(0) * offset**2).sum() / out.sum()
    assert variance == pytest.approx((120 * 0.01 / depth_m) ** 2, rel=0.03)


def test_subsurface_scattering_stays_within_the_body(light: SceneLight, camera: Nominal) -> None:
    box = light.left.body == 2
    only_box = dataclasses.replace(light.left, laser_e=np.where(box, light.left.laser_e, 0.0))
    both = SceneLight(left=only_box, right=light.right)
    out = _leave(both, camera, subsurface=0.005).laser_e
    assert not out[~box].any()
    assert out[box].std() < only_box.laser_e[box].std()
