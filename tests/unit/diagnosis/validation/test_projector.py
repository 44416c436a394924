"""The projector: strengths have the meaning of the effect pages, with independent formulas."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from starling.diagnosis.validation.camera import dots, projector
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.dots import ProjectorDots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal

NONE = ProjectorDots(tangents=np.empty((0, 2)))


def _project(view: LightView, camera: Nominal, **values: float) -> LightView:
    return projector.project(view, Strengths(nominal=camera, values=values), NONE, Draws(seed=0))


@pytest.fixture
def one_dot(light: SceneLight, camera: Nominal) -> LightView:
    """A point of light at the centre of a uniform frontal wall at 1 m."""
    across, down = camera.tangents()
    laser = np.zeros(camera.shape)
    laser[31, 47] = 900.0
    return dataclasses.replace(
        light.left,
        laser_e=laser,
        even_e=np.ones(camera.shape),
        depth_m=np.ones(camera.shape),
        px=across,
        py=down,
    )


def _variance_px2(view: LightView) -> float:
    offset = np.arange(view.laser_e.shape[1]) - 47
    return float((view.laser_e.sum(0) * offset**2).sum() / view.laser_e.sum())


@pytest.mark.parametrize("sigma_mrad", [2.0, 4.0, 12.0])
def test_dot_blur_adds_its_angular_variance(
    sigma_mrad: float, one_dot: LightView, camera: Nominal
) -> None:
    blurred = _project(one_dot, camera, dot_blur=sigma_mrad)
    assert _variance_px2(blurred) == pytest.approx((0.12 * sigma_mrad) ** 2, rel=0.03)
    assert blurred.laser_e.sum() == pytest.approx(one_dot.laser_e.sum(), rel=0.01)


def test_dot_blur_is_uniform_in_direction_cosines(one_dot: LightView, camera: Nominal) -> None:
    """Law: the added covariance is that of the tangents of rays scattered in direction cosines.

    It grows off the axis, most in the radial direction.
    """
    scatter = np.random.default_rng(0).normal(0.0, 1e-3, (2, 100_000))  # 1 mrad.
    for x, y in ((0.0, 0.0), (0.5, 0.0), (0.8, -0.5)):
        cosines = np.array([x, y]) / math.sqrt(1.0 + x**2 + y**2)
        u, v = cosines[:, None] + scatter
        scattered = np.stack([u, v]) / np.sqrt(1.0 - u**2 - v**2)
        tangents = {"px": np.full(camera.shape, x), "py": np.full(camera.shape, y)}
        view = dataclasses.replace(one_dot, **tangents)
        added = projector.added_variance(view, Strengths(nominal=camera, values={"dot_blur": 1.0}))
        law = camera.fx_px**2 * np.cov(scattered)
        covariance = [[added.xx[0, 0], added.xy[0, 0]], [added.xy[0, 0], added.yy[0, 0]]]
        np.testing.assert_allclose(covariance, law, rtol=0.02, atol=0.01 * law[0, 0])


def test_dot_blur_keeps_shading_and_shadows_sharp(light: SceneLight, camera: Nominal) -> None:
    flat = dataclasses.replace(light.left, laser_e=light.left.even_e)
    np.testing.assert_allclose(_project(flat, camera, dot_blur=4.0).laser_e, flat.even_e, rtol=1e-9)


def test_defocus_follows_the_law_of_the_page(one_dot: LightView, camera: Nominal) -> None:
    """Law: sigma = k |1/z - 1/focus|, 0 at the focus."""
    for depth_m, focus_m in ((0.4, 1.0), (0.4, 2.0), (3.0, 0.5)):
        near = dataclasses.replace(one_dot, depth_m=np.full(camera.shape, depth_m))
        focused = dataclasses.replace(camera, projector_focus_m=focus_m)
        sigma_px = 0.12 * 6.0 * abs(1 / depth_m - 1 / focus_m)
        variance = _variance_px2(_project(near, focused, dot_defocus=6.0))
        assert variance == pytest.approx(sigma_px**2, rel=0.03)
    sharp = _project(one_dot, camera, dot_defocus=6.0)  # The default focus is 1 m.
    np.testing.assert_array_equal(sharp.laser_e, one_dot.laser_e)


@pytest.mark.parametrize("exponent", [0.5, 2.0, 6.0])
def test_falloff_agrees_with_the_page_on_the_axis_and_at_the_edge(
    exponent: float, light: SceneLight, camera: Nominal
) -> None:
    """Between both, a Gaussian beam differs from cos^n by less than 0.06."""
    tangent = np.linspace(0.0, 1.0, camera.width)[None, :] * np.ones((camera.height, 1))
    view = dataclasses.replace(light.left, px=tangent, py=np.zeros(camera.shape))
    factor = projector.falloff(view, exponent)[0]
    law = np.cos(np.arctan(tangent[0])) ** exponent
    assert factor[0] == pytest.approx(1.0)
    assert factor[-1] == pytest.approx(2 ** (-exponent / 2))
    assert np.abs(factor - law).max() < 0.06
    dimmed = _project(view, camera, projector_falloff=exponent)
    np.testing.assert_allclose(dimmed.laser_e, view.laser_e * factor)
    assert dimmed.ambient_e is view.ambient_e


def test_power_scales_the_laser_light(light: SceneLight, camera: Nominal) -> None:
    view = _project(light.left, camera, projector_power=0.3)
    np.testing.assert_allclose(view.laser_e, 2.0 * light.left.laser_e)
    assert _project(light.left, camera) is light.left


def test_flicker_has_mean_one_and_its_standard_deviation() -> None:
    power = [projector.flicker(0.2, Draws(seed=1, frame=frame)) for frame in range(3000)]
    assert np.mean(power) == pytest.approx(1.0, abs=0.012)
    assert np.std(power) == pytest.approx(0.2, rel=0.05)


def test_flicker_is_the_same_in_both_imagers(light: SceneLight, camera: Nominal) -> None:
    left, right = (_project(view, camera, flicker=0.3) for view in (light.left, light.right))
    ratio = left.laser_e.sum() / light.left.laser_e.sum()
    assert right.laser_e.sum() / light.right.laser_e.sum() == pytest.approx(ratio)
    assert not math.isclose(ratio, 1.0, rel_tol=1e-3)


def test_dropped_dots_are_the_same_in_all_scenes(
    light: SceneLight, projector_dots: ProjectorDots
) -> None:
    draws = (Draws(seed=1, scene="a"), Draws(seed=1, scene="b", frame=2))
    first, second = (
        dots.dropped(light.left, projector_dots, 0.3, stream.device_rng("projector/dropped"))
        for stream in draws
    )
    np.testing.assert_array_equal(first.laser_e, second.laser_e)


@pytest.mark.parametrize(("name", "value"), [("dropped_dots", 0.3), ("shifted_dots", 4.0)])
def test_changed_dots_are_the_same_in_all_scenes_and_frames(
    name: str, value: float, light: SceneLight, camera: Nominal, projector_dots: ProjectorDots
) -> None:
    strengths = Strengths(nominal=camera, values={name: value})
    first, second = (
        projector.project(
            light.left, strengths, projector_dots, Draws(seed=1, scene=scene, frame=frame)
        )
        for scene, frame in (("a", 0), ("b", 2))
    )
    np.testing.assert_array_equal(first.laser_e, second.laser_e)
    assert not np.array_equal(first.laser_e, light.left.laser_e)
