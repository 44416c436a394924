"""Sampling of no-depth pixels: share, placement and flicker."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.data.example import Physics
from starling.learning.data.physics import physics_probability
from starling.learning.sampling import sampling
from starling.learning.sampling.perlin import Perlin
from starling.learning.sampling.sampling import Sampling
from starling.patterns.errors import InputError
from starling.sim.captures.info import CaptureInfo
from tests.oracles.flicker import flicker
from tests.unit.learning.step_scenes import step_scene

NOISE = Perlin(correlation_px=2.0, correlation_frames=5.0)
INFO = CaptureInfo(
    sensor="d415", width=40, height=30, fx_px=400, fy_px=400, cx_px=20, cy_px=15, baseline_m=0.05,
    depth_unit_m=0.001, source="drawn", licence="none", notes="",
)  # fmt: skip


def image(value: float, shape: tuple[int, int] = (96, 128)) -> np.ndarray:
    return np.full(shape, value, np.float32)


def test_expected_share_is_the_probability_up_to_the_threshold():
    """A ramp of probabilities, by bins of them, over 60 draws; within 8 % or 0.003."""
    ramp = np.broadcast_to(np.linspace(0, 1, 256, dtype=np.float32), (96, 256))
    drawn = np.mean([sampling.ndp(ramp, Sampling(noise=NOISE), seed=s) for s in range(60)], axis=0)
    for low, high in ((0.0, 0.05), (0.05, 0.1), (0.1, 0.2), (0.2, 0.35), (0.35, 0.5)):
        inside = (ramp > low) & (ramp <= high)
        assert drawn[inside].mean() == pytest.approx(ramp[inside].mean(), rel=0.08, abs=0.003)
    assert (drawn[ramp > 0.5] == 1).all()


@given(seed=st.integers(0, 2**32), threshold=st.floats(0, 1), frame=st.floats(-1e3, 1e3))
def test_certain_pixels_are_certain(seed, threshold, frame):
    how = Sampling(noise=NOISE, threshold=threshold)
    assert not sampling.ndp(image(0, (9, 12)), how, seed=seed, frame=frame).any()
    assert sampling.ndp(image(1, (9, 12)), how, seed=seed, frame=frame).all()


def test_the_threshold_is_exclusive():
    position, above = image(0.5), image(np.nextafter(np.float32(0.5), np.float32(1)))
    assert 0.3 < sampling.ndp(position, Sampling(noise=NOISE), seed=1).mean() < 0.7
    assert sampling.ndp(above, Sampling(noise=NOISE), seed=1).all()
    everywhere_drawn = Sampling(noise=NOISE, threshold=1.0)
    share = np.mean([sampling.ndp(image(0.8), everywhere_drawn, seed=s) for s in range(30)])
    assert share == pytest.approx(0.8, abs=0.02)


def test_holes_are_clustered():
    """A no-depth pixel has a no-depth neighbour much more often than for independent draws."""
    holes = sampling.ndp(image(0.05, (200, 200)), Sampling(noise=NOISE), seed=2)
    neighbour = (holes[:, 1:] & holes[:, :-1]).sum() / holes[:, 1:].sum()
    assert neighbour > 0.5


@pytest.mark.parametrize("later", [1, 3, 10])
@pytest.mark.parametrize("p", [0.02, 0.1, 0.4])
def test_flicker_is_the_closed_form(p, later):
    """Within 12 % of the orthant probability of normal values, an approximation of the noise."""
    how = Sampling(noise=NOISE)
    changed = np.mean(
        [
            sampling.ndp(image(p), how, seed=s) != sampling.ndp(image(p), how, seed=s, frame=later)
            for s in range(40)
        ]
    )
    expected = float(flicker(image(p, (1, 1)), how, later)[0, 0])
    assert changed == pytest.approx(expected, rel=0.12)


def simulated(number: int) -> Physics:
    physics = step_scene(number).physics
    assert physics is not None
    return physics


def test_the_simulated_probability_gives_the_first_simulated_draw():
    physics = simulated(0)
    report = physics_probability(physics)
    for seed in range(3):
        drawn = sampling.ndp(report, Sampling(noise=NOISE), seed=seed, physics=physics)
        np.testing.assert_array_equal(drawn, physics.one_draw_ndp)


@given(seed=st.integers(0, 2**32))
def test_holes_of_physics_stay_or_go_as_a_whole(seed):
    physics = simulated(1)
    report = physics_probability(physics)
    fewer = sampling.ndp(
        (report / 2).astype(np.float32), Sampling(noise=NOISE), seed=seed, physics=physics
    )
    count, label = cv2.connectedComponents(physics.one_draw_ndp.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        inside = fewer[label == number]
        assert inside.all() or not inside.any()
    assert not (fewer & ~physics.one_draw_ndp).any()


def separate_holes(every: int) -> Physics:
    """Return a simulation whose holes are single pixels, all equally probable."""
    drawn = np.zeros((96, 128), bool)
    drawn[::every, ::every] = True
    share = np.full(drawn.shape, 0.3, np.float32)
    return dataclasses.replace(simulated(0), ndp=share, draws=1000, one_draw_ndp=drawn)


@pytest.mark.parametrize("factor", [0.0, 0.3, 0.8, 1.0])
def test_the_share_of_holes_that_stay_is_the_ratio_of_probabilities(factor):
    physics = separate_holes(4)
    probability = (factor * physics_probability(physics)).astype(np.float32)
    how = Sampling(noise=NOISE)
    drawn = [sampling.ndp(probability, how, seed=s, physics=physics) for s in range(40)]
    stays = np.mean([each.sum() / physics.one_draw_ndp.sum() for each in drawn])
    assert stays == pytest.approx(factor, rel=0.05)


@pytest.mark.parametrize("step, added", [(-0.01, False), (0.01, True)])
def test_pixels_are_added_where_physics_misses_a_hole_above_the_threshold(step: float, added: bool):
    physics = separate_holes(8)
    report = physics_probability(physics)
    probability = (report + (0.6 + step) * (1 - report)).astype(np.float32)
    drawn = sampling.ndp(probability, Sampling(noise=NOISE, threshold=0.6), seed=3, physics=physics)
    assert drawn[~physics.one_draw_ndp].all() if added else not drawn[~physics.one_draw_ndp].any()
    assert drawn[physics.one_draw_ndp].all()


def test_a_simulation_without_depth_has_one_hole():
    nothing = dataclasses.replace(separate_holes(4), one_draw_ndp=np.ones((96, 128), bool))
    report = physics_probability(nothing)
    assert sampling.ndp(report, Sampling(noise=NOISE), seed=0, physics=nothing).all()
    assert not sampling.ndp(0 * report, Sampling(noise=NOISE), seed=0, physics=nothing).any()


def test_depth_image_has_holes_and_a_simulators_errors():
    reference = np.full(INFO.shape, 2.0, np.float32)  # 10 px.
    reference[0] = np.nan
    ndp = np.zeros(INFO.shape, bool)
    ndp[5] = True
    error = np.full(INFO.shape, np.nan, np.float32)
    error[10] = -2.0
    seen = sampling.depth_image(reference, ndp, INFO, error_px=error)
    assert np.isnan(seen[[0, 5]]).all()
    np.testing.assert_allclose(seen[10], 2.5, rtol=1e-6)
    assert (seen[11:] == 2.0).all()
    plain = sampling.depth_image(reference, ndp, INFO)
    np.testing.assert_array_equal(plain, np.where(ndp, np.nan, reference))


def test_invalid_probabilities_are_refused():
    how = Sampling(noise=NOISE)
    for value in (np.nan, -0.1, 1.1):
        with pytest.raises(InputError, match=r"probability must be in \[0, 1\]; got"):
            sampling.ndp(image(value, (4, 4)), how, seed=0)
    with pytest.raises(InputError, match=r"probability must be an image \(h, w\); got \(3,\)"):
        sampling.ndp(np.zeros(3, np.float32), how, seed=0)
    with pytest.raises(InputError, match=r"threshold must be in \[0, 1\]; got 1\.5"):
        Sampling(noise=NOISE, threshold=1.5)
    with pytest.raises(InputError, match=r"probability must have the size of the physics; got"):
        sampling.ndp(image(0.5, (4, 4)), how, seed=0, physics=simulated(0))
