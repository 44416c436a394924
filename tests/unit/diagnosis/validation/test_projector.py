"""The projector and its dots follow the effect pages, with independent formulas."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial import KDTree

from starling.diagnosis.validation.camera import projector
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.projector import Dots

EVEN = 0.3  # Share of the light of `with_background` that is background.


@pytest.fixture
def with_background(light: SceneLight) -> LightView:
    """The left view with 70 % of the light in dots over a uniform background of 30 %."""
    on = light.left.lit()
    whole = light.left.pattern()
    over = np.where(on, whole - whole[on].min(), 0.0)
    pattern = EVEN + (1.0 - EVEN) * over / over[on].mean()
    return dataclasses.replace(light.left, laser_e=light.left.even_e * pattern)


def _rng() -> np.random.Generator:
    return Draws(seed=2).device_rng("projector/dropped")


def _visible(directions: np.ndarray, view: LightView) -> np.ndarray:
    """Dots whose centre is visible in a view."""
    pixels = np.stack([view.px, view.py], -1)[np.isfinite(view.px)]
    return directions[KDTree(pixels).query(directions)[0] < 0.005]


def test_dots_are_detected_at_their_directions(
    light: SceneLight, projector_dots: Dots, dot_directions: np.ndarray
) -> None:
    visible = _visible(dot_directions, light.left)
    distance = KDTree(projector_dots).query(visible)[0]
    assert np.median(distance) < 0.5 / 120
    assert np.mean(distance < 1.0 / 120) > 0.9
    assert len(projector_dots) == pytest.approx(
        len(dot_directions[_inside(dot_directions)]), rel=0.3
    )


def _inside(directions: np.ndarray) -> np.ndarray:
    return (np.abs(directions[:, 0]) < 0.42) & (np.abs(directions[:, 1]) < 0.27)


def test_the_background_is_the_light_between_the_dots(with_background: LightView) -> None:
    """It holds with render noise too. There is no background where there is no light."""
    on = with_background.lit()
    assert projector.background(with_background)[on].max() == pytest.approx(EVEN, abs=0.03)
    grain = 1.0 + 0.05 * np.random.default_rng(0).standard_normal(on.shape)
    grainy = dataclasses.replace(with_background, laser_e=with_background.laser_e * grain)
    assert projector.background(grainy)[on].max() == pytest.approx(EVEN, abs=0.03)
    assert not projector.background(with_background)[~on].any()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_dropped_dots_reduce_the_light_by_their_share(
    share: float, with_background: LightView, projector_dots: Dots
) -> None:
    """Law: the light of the dots scales by 1 - share; the background stays."""
    on = with_background.lit()
    before, after = with_background.pattern()[on], []
    for seed in range(20):
        rng = Draws(seed=seed).device_rng("projector/dropped")
        after.append(projector.dropped(with_background, projector_dots, share, rng).pattern()[on])
    assert np.mean(after) / before.mean() == pytest.approx(1.0 - (1.0 - EVEN) * share, abs=0.02)
    assert np.min(after) == pytest.approx(before.min())
    assert projector.dropped(with_background, projector_dots, 0.0, _rng()) is with_background


def test_shifted_dots_keep_the_background(
    with_background: LightView, camera: Nominal, projector_dots: Dots
) -> None:
    on = with_background.lit()
    before, after = with_background.pattern()[on], []
    for seed in range(10):
        rng = Draws(seed=seed).device_rng("projector/shifted")
        after.append(
            projector.shifted(with_background, projector_dots, 8.0, camera.fx_px, rng).pattern()[on]
        )
    assert np.min(after) > 0.99 * before.min()
    assert np.mean(after) == pytest.approx(before.mean(), abs=0.02)


def test_the_same_dots_are_dropped_in_both_imagers(light: SceneLight, projector_dots: Dots) -> None:
    """Expected behaviour: a direction that is dark in the left view is dark in the right view."""
    samples = []
    for whole in (light.left, light.right):
        view = projector.dropped(whole, projector_dots, 0.5, _rng())
        on = view.lit()
        tree = KDTree(np.stack([view.px[on], view.py[on]], 1))
        distance, pixel = tree.query(projector_dots)
        over = view.pattern() - projector.background(whole)
        samples.append(np.where(distance < 0.005, over[on][pixel], np.nan))
    both = np.isfinite(samples[0]) & np.isfinite(samples[1])
    assert both.sum() > 50
    dark = [sample[both] < 1e-9 for sample in samples]
    assert 0.3 < dark[0].mean() < 0.7
    assert np.mean(dark[0] == dark[1]) > 0.97


def test_shifts_have_the_given_standard_deviation(
    light: SceneLight, camera: Nominal, projector_dots: Dots
) -> None:
    """Results: the centroids of isolated dots move by f sigma on both axes."""
    even = np.full(camera.shape, 100.0)
    across, down = camera.tangents()
    grid = np.stack(np.meshgrid(np.arange(-0.35, 0.36, 0.1), np.arange(-0.2, 0.21, 0.1)), -1)
    few = grid.reshape(-1, 2)
    bright = np.zeros(camera.shape)
    for x, y in few:
        bright += np.exp(-((across - x) ** 2 + (down - y) ** 2) / (2 * 0.012**2))
    view = dataclasses.replace(light.left, laser_e=even * bright, even_e=even, px=across, py=down)
    moves = []
    for seed in range(12):
        rng = Draws(seed=seed).device_rng("projector/shifted")
        moved = projector.shifted(view, few, 8.0, camera.fx_px, rng)
        assert moved.laser_e.sum() == pytest.approx(view.laser_e.sum(), rel=0.01)
        owner = projector.nearest_dot(view, few)
        for number in range(len(few)):
            cell = owner == number
            before, after = view.laser_e[cell], moved.laser_e[cell]
            for tangent in (across[cell], down[cell]):
                move = np.average(tangent, weights=after) - np.average(tangent, weights=before)
                moves.append(move * 1e3)
    assert np.std(moves) == pytest.approx(8.0, rel=0.12)
    assert np.mean(moves) == pytest.approx(0.0, abs=0.6)
    assert projector.shifted(view, few, 0.0, camera.fx_px, _rng()) is view


def test_a_second_pattern_is_shifted_and_dimmer(light: SceneLight) -> None:
    view = projector.doubled(light.left, 0.5, (5.0, 0.0))
    first, both = light.left.pattern(), view.pattern()
    inner = np.s_[20:60, 20:60]
    expected = (first[:, 20:60] + 0.5 * first[:, 15:55])[20:60] / 1.5
    assert np.median(np.abs(both[inner] - expected)) < 1e-9
    assert projector.doubled(light.left, 0.0, (5.0, 0.0)) is light.left


def test_dark_scenes_have_no_dots(light: SceneLight, camera: Nominal) -> None:
    dark = dataclasses.replace(light.left, laser_e=np.zeros(camera.shape))
    night = dataclasses.replace(dark, even_e=np.zeros(camera.shape))
    for view in (dark, night):
        detected = projector.gather([SceneLight(left=view, right=view)], camera.fx_px)
        assert len(detected) == 0
        assert not projector.dropped(view, detected, 0.5, _rng()).laser_e.any()
        assert not projector.shifted(view, detected, 5.0, 120.0, _rng()).laser_e.any()


def test_dots_off_the_axis_move_further_radially(light: SceneLight, camera: Nominal) -> None:
    """Law: a small angle moves a tangent t by (1 + t^2) times the angle, axis by axis."""
    across, down = np.broadcast_arrays(*camera.tangents())
    bright = np.exp(-(across**2 + down**2) / (2 * 0.012**2))
    even = np.full(camera.shape, 100.0)

    def moved(tangent: float) -> np.ndarray:
        dot = np.array([[tangent, 0.0]])
        view = dataclasses.replace(
            light.left, laser_e=100 * bright, even_e=even, px=across + tangent, py=down
        )
        rng = Draws(seed=2).device_rng("projector/shifted")
        laser_e = projector.shifted(view, dot, 8.0, camera.fx_px, rng).laser_e
        return np.array([np.average(axis, weights=laser_e) for axis in (across, down)])

    np.testing.assert_allclose(moved(1.0) / moved(0.0), [2.0, 1.0], rtol=0.03)


NONE = np.empty((0, 2))


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
        xx, yy, xy = added[:, 0, 0]
        law = camera.fx_px**2 * np.cov(scattered)
        covariance = [[xx, xy], [xy, yy]]
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


def test_dropped_dots_are_the_same_in_all_scenes(light: SceneLight, projector_dots: Dots) -> None:
    draws = (Draws(seed=1, scene="a"), Draws(seed=1, scene="b", frame=2))
    first, second = (
        projector.dropped(light.left, projector_dots, 0.3, stream.device_rng("projector/dropped"))
        for stream in draws
    )
    np.testing.assert_array_equal(first.laser_e, second.laser_e)


@pytest.mark.parametrize(("name", "value"), [("dropped_dots", 0.3), ("shifted_dots", 4.0)])
def test_changed_dots_are_the_same_in_all_scenes_and_frames(
    name: str, value: float, light: SceneLight, camera: Nominal, projector_dots: Dots
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
