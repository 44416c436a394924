"""Dots one by one: found where they are, and the same dot in both imagers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial import KDTree

from starling.diagnosis.validation.camera import dots
from starling.diagnosis.validation.camera.dots import Dots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import Light, View
from starling.diagnosis.validation.camera.nominal import Nominal

EVEN = 0.3  # Share of `grounded`'s light that is in no dot.


@pytest.fixture
def grounded(light: Light) -> View:
    """The left view with dots of 0.7 of the light over an even 0.3."""
    on = dots.lit(light.left)
    whole = dots.pattern(light.left)
    over = np.where(on, whole - whole[on].min(), 0.0)
    pattern = EVEN + (1.0 - EVEN) * over / over[on].mean()
    return dataclasses.replace(light.left, laser_e=light.left.even_e * pattern)


def _rng() -> np.random.Generator:
    return Draws(seed=2).of_device("projector/dropped")


def _seen(directions: np.ndarray, view: View) -> np.ndarray:
    """Dots whose middle one view shows."""
    pixels = np.stack([view.px, view.py], -1)[np.isfinite(view.px)]
    return directions[KDTree(pixels).query(directions)[0] < 0.005]


def test_dots_are_found_where_they_are(
    light: Light, found: Dots, dot_directions: np.ndarray
) -> None:
    seen = _seen(dot_directions, light.left)
    away = KDTree(found.tangents).query(seen)[0]
    assert np.median(away) < 0.5 / 120
    assert np.mean(away < 1.0 / 120) > 0.9
    assert len(found.tangents) == pytest.approx(
        len(dot_directions[_inside(dot_directions)]), rel=0.3
    )


def _inside(directions: np.ndarray) -> np.ndarray:
    return (np.abs(directions[:, 0]) < 0.42) & (np.abs(directions[:, 1]) < 0.27)


def test_the_ground_is_the_light_between_the_dots(grounded: View) -> None:
    """Also under the grain of a renderer; no ground is where no light is."""
    on = dots.lit(grounded)
    assert dots.ground(grounded)[on].max() == pytest.approx(EVEN, abs=0.03)
    grain = 1.0 + 0.05 * np.random.default_rng(0).standard_normal(on.shape)
    grainy = dataclasses.replace(grounded, laser_e=grounded.laser_e * grain)
    assert dots.ground(grainy)[on].max() == pytest.approx(EVEN, abs=0.03)
    assert not dots.ground(grounded)[~on].any()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_share_of_the_dots_goes_with_its_light(share: float, grounded: View, found: Dots) -> None:
    """Law: the dots' light falls to 1 - share; what is in no dot stays."""
    on = dots.lit(grounded)
    before, after = dots.pattern(grounded)[on], []
    for seed in range(20):
        rng = Draws(seed=seed).of_device("projector/dropped")
        after.append(dots.pattern(dots.dropped(grounded, found, share, rng))[on])
    assert np.mean(after) / before.mean() == pytest.approx(1.0 - (1.0 - EVEN) * share, abs=0.02)
    assert np.min(after) == pytest.approx(before.min())
    assert dots.dropped(grounded, found, 0.0, _rng()) is grounded


def test_shifted_dots_leave_the_ground(grounded: View, camera: Nominal, found: Dots) -> None:
    on = dots.lit(grounded)
    before, after = dots.pattern(grounded)[on], []
    for seed in range(10):
        rng = Draws(seed=seed).of_device("projector/shifted")
        after.append(dots.pattern(dots.shifted(grounded, found, 8.0, camera.fx_px, rng))[on])
    assert np.min(after) > 0.99 * before.min()
    assert np.mean(after) == pytest.approx(before.mean(), abs=0.02)


def test_the_same_dots_are_dark_in_both_imagers(light: Light, found: Dots) -> None:
    """Expected behaviour: a direction dark in one view is dark in the other."""
    samples = []
    for whole in (light.left, light.right):
        view = dots.dropped(whole, found, 0.5, _rng())
        on = dots.lit(view)
        tree = KDTree(np.stack([view.px[on], view.py[on]], 1))
        away, at = tree.query(found.tangents)
        over = dots.pattern(view) - dots.ground(whole)
        samples.append(np.where(away < 0.005, over[on][at], np.nan))
    both = np.isfinite(samples[0]) & np.isfinite(samples[1])
    assert both.sum() > 50
    dark = [sample[both] < 1e-9 for sample in samples]
    assert 0.3 < dark[0].mean() < 0.7
    assert np.mean(dark[0] == dark[1]) > 0.97


def test_shifts_have_the_pages_deviation(light: Light, camera: Nominal, found: Dots) -> None:
    """Results: centroids of isolated dots move by f sigma, on both axes."""
    even = np.full(camera.shape, 100.0)
    across, down = camera.tangents()
    grid = np.stack(np.meshgrid(np.arange(-0.35, 0.36, 0.1), np.arange(-0.2, 0.21, 0.1)), -1)
    few = Dots(tangents=grid.reshape(-1, 2))
    bright = np.zeros(camera.shape)
    for x, y in few.tangents:
        bright += np.exp(-((across - x) ** 2 + (down - y) ** 2) / (2 * 0.012**2))
    view = dataclasses.replace(light.left, laser_e=even * bright, even_e=even, px=across, py=down)
    moves = []
    for seed in range(12):
        rng = Draws(seed=seed).of_device("projector/shifted")
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


def test_a_second_pattern_falls_beside_the_first(light: Light) -> None:
    view = dots.doubled(light.left, 0.5, (5.0, 0.0))
    first, both = dots.pattern(light.left), dots.pattern(view)
    inner = np.s_[20:60, 20:60]
    expected = (first[:, 20:60] + 0.5 * first[:, 15:55])[20:60] / 1.5
    assert np.median(np.abs(both[inner] - expected)) < 1e-9
    assert dots.doubled(light.left, 0.0, (5.0, 0.0)) is light.left


def test_no_dots_is_no_failure(light: Light, camera: Nominal) -> None:
    dark = dataclasses.replace(light.left, laser_e=np.zeros(camera.shape))
    night = dataclasses.replace(dark, even_e=np.zeros(camera.shape))
    for view in (dark, night):
        found = dots.gather([Light(left=view, right=view)], camera.fx_px)
        assert len(found.tangents) == 0
        assert not dots.dropped(view, found, 0.5, _rng()).laser_e.any()
        assert not dots.shifted(view, found, 5.0, 120.0, _rng()).laser_e.any()


def test_dots_off_the_axis_move_further_along_it(light: Light, camera: Nominal) -> None:
    """Law: an angle moves a tangent t by 1 + t^2, each axis by its own."""
    across, down = np.broadcast_arrays(*camera.tangents())
    bright = np.exp(-(across**2 + down**2) / (2 * 0.012**2))
    even = np.full(camera.shape, 100.0)

    def moved(at: float) -> np.ndarray:
        few = Dots(tangents=np.array([[at, 0.0]]))
        view = dataclasses.replace(
            light.left, laser_e=100 * bright, even_e=even, px=across + at, py=down
        )
        rng = Draws(seed=2).of_device("projector/shifted")
        seen = dots.shifted(view, few, 8.0, camera.fx_px, rng).laser_e
        return np.array([np.average(one, weights=seen) for one in (across, down)])

    np.testing.assert_allclose(moved(1.0) / moved(0.0), [2.0, 1.0], rtol=0.03)
