"""Detection of single dots, and effects on the same dots in both imagers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial import KDTree

from starling.diagnosis.validation.camera import dots
from starling.diagnosis.validation.camera.dots import ProjectorDots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal

EVEN = 0.3  # Share of the light of `with_background` that is background.


@pytest.fixture
def with_background(light: SceneLight) -> LightView:
    """The left view with 70 % of the light in dots over a uniform background of 30 %."""
    on = dots.lit(light.left)
    whole = dots.pattern(light.left)
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
    light: SceneLight, projector_dots: ProjectorDots, dot_directions: np.ndarray
) -> None:
    visible = _visible(dot_directions, light.left)
    distance = KDTree(projector_dots.tangents).query(visible)[0]
    assert np.median(distance) < 0.5 / 120
    assert np.mean(distance < 1.0 / 120) > 0.9
    assert len(projector_dots.tangents) == pytest.approx(
        len(dot_directions[_inside(dot_directions)]), rel=0.3
    )


def _inside(directions: np.ndarray) -> np.ndarray:
    return (np.abs(directions[:, 0]) < 0.42) & (np.abs(directions[:, 1]) < 0.27)


def test_the_background_is_the_light_between_the_dots(with_background: LightView) -> None:
    """It holds with render noise too. There is no background where there is no light."""
    on = dots.lit(with_background)
    assert dots.background(with_background)[on].max() == pytest.approx(EVEN, abs=0.03)
    grain = 1.0 + 0.05 * np.random.default_rng(0).standard_normal(on.shape)
    grainy = dataclasses.replace(with_background, laser_e=with_background.laser_e * grain)
    assert dots.background(grainy)[on].max() == pytest.approx(EVEN, abs=0.03)
    assert not dots.background(with_background)[~on].any()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_dropped_dots_reduce_the_light_by_their_share(
    share: float, with_background: LightView, projector_dots: ProjectorDots
) -> None:
    """Law: the light of the dots scales by 1 - share; the background stays."""
    on = dots.lit(with_background)
    before, after = dots.pattern(with_background)[on], []
    for seed in range(20):
        rng = Draws(seed=seed).device_rng("projector/dropped")
        after.append(dots.pattern(dots.dropped(with_background, projector_dots, share, rng))[on])
    assert np.mean(after) / before.mean() == pytest.approx(1.0 - (1.0 - EVEN) * share, abs=0.02)
    assert np.min(after) == pytest.approx(before.min())
    assert dots.dropped(with_background, projector_dots, 0.0, _rng()) is with_background


def test_shifted_dots_keep_the_background(
    with_background: LightView, camera: Nominal, projector_dots: ProjectorDots
) -> None:
    on = dots.lit(with_background)
    before, after = dots.pattern(with_background)[on], []
    for seed in range(10):
        rng = Draws(seed=seed).device_rng("projector/shifted")
        after.append(
            dots.pattern(dots.shifted(with_background, projector_dots, 8.0, camera.fx_px, rng))[on]
        )
    assert np.min(after) > 0.99 * before.min()
    assert np.mean(after) == pytest.approx(before.mean(), abs=0.02)


def test_the_same_dots_are_dropped_in_both_imagers(
    light: SceneLight, projector_dots: ProjectorDots
) -> None:
    """Expected behaviour: a direction that is dark in the left view is dark in the right view."""
    samples = []
    for whole in (light.left, light.right):
        view = dots.dropped(whole, projector_dots, 0.5, _rng())
        on = dots.lit(view)
        tree = KDTree(np.stack([view.px[on], view.py[on]], 1))
        distance, pixel = tree.query(projector_dots.tangents)
        over = dots.pattern(view) - dots.background(whole)
        samples.append(np.where(distance < 0.005, over[on][pixel], np.nan))
    both = np.isfinite(samples[0]) & np.isfinite(samples[1])
    assert both.sum() > 50
    dark = [sample[both] < 1e-9 for sample in samples]
    assert 0.3 < dark[0].mean() < 0.7
    assert np.mean(dark[0] == dark[1]) > 0.97


def test_shifts_have_the_given_standard_deviation(
    light: SceneLight, camera: Nominal, projector_dots: ProjectorDots
) -> None:
    """Results: the centroids of isolated dots move by f sigma on both axes."""
    even = np.full(camera.shape, 100.0)
    across, down = camera.tangents()
    grid = np.stack(np.meshgrid(np.arange(-0.35, 0.36, 0.1), np.arange(-0.2, 0.21, 0.1)), -1)
    few = ProjectorDots(tangents=grid.reshape(-1, 2))
    bright = np.zeros(camera.shape)
    for x, y in few.tangents:
        bright += np.exp(-((across - x) ** 2 + (down - y) ** 2) / (2 * 0.012**2))
    view = dataclasses.replace(light.left, laser_e=even * bright, even_e=even, px=across, py=down)
    moves = []
    for seed in range(12):
        rng = Draws(seed=seed).device_rng("projector/shifted")
        moved = dots.shifted(view, few, 8.0, camera.fx_px, rng)
        assert moved.laser_e.sum() == pytest.approx(view.laser_e.sum(), rel=0.01)
        owner = few.owner(view)
        for number in range(len(few.tangents)):
            cell = owner == number
            before, after = view.laser_e[cell], moved.laser_e[cell]
            for tangent in (across[cell], down[cell]):
                move = np.average(tangent, weights=after) - np.average(tangent, weights=before)
                moves.append(move * 1e3)
    assert np.std(moves) == pytest.approx(8.0, rel=0.12)
    assert np.mean(moves) == pytest.approx(0.0, abs=0.6)
    assert dots.shifted(view, few, 0.0, camera.fx_px, _rng()) is view


def test_a_second_pattern_is_shifted_and_dimmer(light: SceneLight) -> None:
    view = dots.doubled(light.left, 0.5, (5.0, 0.0))
    first, both = dots.pattern(light.left), dots.pattern(view)
    inner = np.s_[20:60, 20:60]
    expected = (first[:, 20:60] + 0.5 * first[:, 15:55])[20:60] / 1.5
    assert np.median(np.abs(both[inner] - expected)) < 1e-9
    assert dots.doubled(light.left, 0.0, (5.0, 0.0)) is light.left


def test_dark_scenes_have_no_dots(light: SceneLight, camera: Nominal) -> None:
    dark = dataclasses.replace(light.left, laser_e=np.zeros(camera.shape))
    night = dataclasses.replace(dark, even_e=np.zeros(camera.shape))
    for view in (dark, night):
        detected = dots.gather([SceneLight(left=view, right=view)], camera.fx_px)
        assert len(detected.tangents) == 0
        assert not dots.dropped(view, detected, 0.5, _rng()).laser_e.any()
        assert not dots.shifted(view, detected, 5.0, 120.0, _rng()).laser_e.any()


def test_dots_off_the_axis_move_further_radially(light: SceneLight, camera: Nominal) -> None:
    """Law: a small angle moves a tangent t by (1 + t^2) times the angle, axis by axis."""
    across, down = np.broadcast_arrays(*camera.tangents())
    bright = np.exp(-(across**2 + down**2) / (2 * 0.012**2))
    even = np.full(camera.shape, 100.0)

    def moved(tangent: float) -> np.ndarray:
        dot = ProjectorDots(tangents=np.array([[tangent, 0.0]]))
        view = dataclasses.replace(
            light.left, laser_e=100 * bright, even_e=even, px=across + tangent, py=down
        )
        rng = Draws(seed=2).device_rng("projector/shifted")
        laser_e = dots.shifted(view, dot, 8.0, camera.fx_px, rng).laser_e
        return np.array([np.average(axis, weights=laser_e) for axis in (across, down)])

    np.testing.assert_allclose(moved(1.0) / moved(0.0), [2.0, 1.0], rtol=0.03)
