"""Repeated draws over one rendering: shares, means, and reasons of what has no depth."""

from __future__ import annotations

import types
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data import simulated
from starling.learning.data.example import Physics
from starling.patterns.errors import InputError
from starling.sim import simulate
from starling.sim.reason import Reason
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.builtin import scenes
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from tests.unit.calibration.small_camera import small

SENSOR = small("d435", 64, 32)
NOISE = (
    *("projector.speckle_contrast", "projector.flicker"),
    *("imager.shot_noise", "imager.read_noise_e", "imager.row_noise_e"),
    "imager.dark_current_e_s",
)
IMAGES = ("ndp", "infrared", "contrast", "disparity_px", "reason")


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage(scenes.wall())


def _noise_free() -> Sensor:
    return with_values(SENSOR, [(name, 0.0) for name in NOISE])


@pytest.mark.parametrize("draws", [0, 10_001])
def test_no_draw_or_too_many_are_refused(draws):
    with pytest.raises(InputError) as caught:
        simulated.physics(scenes.wall(), SENSOR, draws=draws)
    line = f"draws must be in [1, 10000]; got {draws}. Simulate at least once."
    assert str(caught.value) == line


def test_one_draw_is_sure_everywhere(stage):
    found = simulated.physics(stage, SENSOR, draws=1, seed=3)
    assert found.draws == 1
    assert set(np.unique(found.ndp)) == {0.0, 1.0}
    assert {getattr(found, name).shape for name in IMAGES} == {(32, 64)}


def test_draws_without_noise_agree(stage):
    """Whatever else is drawn (pixels' sensitivities are not) would show as a share between."""
    sensor = _noise_free()
    one = simulated.physics(stage, sensor, draws=1)
    three = simulated.physics(stage, sensor, draws=3, seed=8)
    for name in IMAGES:
        assert_array_equal(getattr(one, name), getattr(three, name))


def test_noisy_draws_differ_and_a_seed_fixes_them(stage):
    one, same, other = (simulated.physics(stage, SENSOR, draws=4, seed=seed) for seed in (1, 1, 2))
    assert ((one.ndp > 0) & (one.ndp < 1)).any()
    for name in IMAGES:
        assert_array_equal(getattr(one, name), getattr(same, name))
    assert (one.infrared != other.infrared).any()


def test_reason_and_disparity_follow_the_share(stage):
    found = simulated.physics(stage, SENSOR, draws=5)
    assert 0 < np.count_nonzero(found.ndp) < found.ndp.size
    assert_array_equal(found.reason == Reason.VALID, found.ndp == 0)
    assert_array_equal(np.isnan(found.disparity_px), found.ndp == 1)
    assert_allclose(found.ndp * 5, np.round(found.ndp * 5), atol=1e-6)
    assert 0 <= found.infrared.min() < found.infrared.max() <= 1


def test_a_scene_is_rendered_once(stage, monkeypatch):
    asked = []
    real = simulate.simulate
    monkeypatch.setattr(simulate, "simulate", lambda *a, **k: asked.append(k) or real(*a, **k))
    simulated.physics(stage, SENSOR, draws=3, samples=7)
    assert [call["samples"] for call in asked] == [7]


def _shot(reason: np.ndarray, disparity: float, level: np.ndarray | float) -> types.SimpleNamespace:
    valid = reason == Reason.VALID
    disparity_px = np.where(valid, np.float32(disparity), np.float32(np.nan))
    depth = types.SimpleNamespace(valid=valid, reason=reason, disparity_px=disparity_px)
    infrared = np.broadcast_to(np.asarray(level, np.uint8), reason.shape)
    return types.SimpleNamespace(depth=depth, ir_left=infrared, layers=None)


def summary(shots: Sequence[types.SimpleNamespace]) -> Physics:
    """Physics of made shots."""
    with pytest.MonkeyPatch.context() as patch:
        left = iter(shots)
        patch.setattr(simulate, "simulate", lambda *_, **__: next(left))
        patch.setattr(simulate, "expose", lambda *_, **__: next(left))
        patch.setattr(simulated, "Stage", types.SimpleNamespace)
        stage = types.SimpleNamespace(scene=None)
        return simulated.physics(stage, SENSOR, draws=len(shots))  # type: ignore[arg-type]


def test_the_most_frequent_reason_wins_and_of_two_the_first_cause():
    columns = [  # Reasons of four draws, and the one that is told.
        ((0, 0, 0, 0), 0),
        ((0, 0, 0, 8), 8),  # Depth is no reason, however frequent.
        ((3, 10, 10, 10), 10),
        ((7, 7, 5, 5), 5),
        ((13, 8, 4, 0), 4),
        ((9, 9, 2, 0), 9),
    ]
    codes = np.array([codes for codes, _ in columns], np.uint32).T[:, None, :]
    found = summary([_shot(reason, 10, 50) for reason in codes])
    assert found.reason.dtype == np.uint32
    assert found.reason[0].tolist() == [told for _, told in columns]
    assert found.ndp[0].tolist() == [0, 0.25, 1, 1, 0.75, 0.75]


def test_disparity_is_the_mean_of_the_draws_that_have_one():
    codes = np.array([[0, 3, 3], [0, 0, 3], [0, 0, 3]], np.uint32)[:, None, :]
    shots = [
        _shot(reason, disparity, 50)
        for reason, disparity in zip(codes, (3.0, 6.0, 12.0), strict=True)
    ]
    found = summary(shots)
    assert_array_equal(found.disparity_px[0], np.array([7, 9, np.nan], np.float32))
    assert_array_equal(found.one_draw_px[0], np.array([3, 6, np.nan], np.float32))
    assert found.one_draw_ndp[0].tolist() == [False, True, True]


def test_infrared_is_the_mean_level_above_black_over_full_scale():
    black, ceiling = SENSOR.left.black_level_dn, SENSOR.left.ceiling_dn
    depth = np.zeros((1, 4), np.uint32)
    first = np.array([[0, black, 100, ceiling]])
    second = np.array([[0, black, 50, ceiling]])
    found = summary([_shot(depth, 1, first), _shot(depth, 1, second)])
    expected = [0, 0, (75 - black) / (ceiling - black), 1]
    assert_allclose(found.infrared[0], expected, rtol=1e-6)


def test_contrast_is_deviation_over_mean_of_a_window():
    """Columns of 0 and 1 above black in turns: of 9 five or four are 1, so that the window's
    deviation is sqrt(20) / 9 and its mean 5/9 or 4/9. An even image has none."""
    black = round(SENSOR.left.black_level_dn)
    stripes = np.broadcast_to(np.where(np.arange(40) % 2, 255, black), (20, 40))
    depth = np.zeros(stripes.shape, np.uint32)
    found = summary([_shot(depth, 1, stripes)]).contrast[:, 10:30]
    mean = np.where(np.arange(10, 30) % 2, 5, 4)
    assert_allclose(found, np.broadcast_to(np.sqrt(20) / mean, found.shape), rtol=1e-3)
    assert_allclose(summary([_shot(depth, 1, 99)]).contrast, 0, atol=1e-3)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), draws=st.integers(1, 6))
def test_whatever_is_drawn_the_images_agree_with_each_other(seed, draws):
    rng = np.random.default_rng(seed)
    codes = rng.choice([0, 0, 2, 3, 8, 13], (draws, 3, 5)).astype(np.uint32)
    found = summary([_shot(reason, 4.0, 80) for reason in codes])
    assert_array_equal(found.reason == 0, found.ndp == 0)
    assert_array_equal(np.isnan(found.disparity_px), found.ndp == 1)
    assert_allclose(found.ndp, (codes != 0).mean(axis=0), rtol=1e-6)
    where = found.reason > 0
    occurs = (codes == found.reason).any(axis=0)
    assert occurs[where].all()
