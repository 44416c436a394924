"""Repeated draws for one rendering: shares, means, and reasons of missing depth."""

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
from starling.sim.render.mitsuba_scene import MitsubaScene
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
def stage() -> MitsubaScene:
    return MitsubaScene(scenes.wall())


def _noise_free() -> Sensor:
    return with_values(SENSOR, [(name, 0.0) for name in NOISE])


@pytest.mark.parametrize("draws", [0, 10_001])
def test_no_draw_or_too_many_are_refused(draws):
    with pytest.raises(InputError) as caught:
        simulated.physics(scenes.wall(), SENSOR, draws=draws)
    line = f"draws must be in [1, 10000]; got {draws}. Simulate at least once."
    assert str(caught.value) == line


def test_one_draw_has_shares_of_0_and_1(stage):
    result = simulated.physics(stage, SENSOR, draws=1, seed=3)
    assert result.draws == 1
    assert set(np.unique(result.ndp)) == {0.0, 1.0}
    assert {getattr(result, name).shape for name in IMAGES} == {(32, 64)}


def test_draws_without_noise_agree(stage):
    """Pixels' sensitivities are fixed; another random input would give shares between 0 and 1."""
    sensor = _noise_free()
    item = simulated.physics(stage, sensor, draws=1)
    three = simulated.physics(stage, sensor, draws=3, seed=8)
    for name in IMAGES:
        assert_array_equal(getattr(item, name), getattr(three, name))


def test_noisy_draws_differ_and_depend_on_the_seed(stage):
    item, same, second = (
        simulated.physics(stage, SENSOR, draws=4, seed=seed) for seed in (1, 1, 2)
    )
    assert ((item.ndp > 0) & (item.ndp < 1)).any()
    for name in IMAGES:
        assert_array_equal(getattr(item, name), getattr(same, name))
    assert (item.infrared != second.infrared).any()


def test_reason_and_disparity_agree_with_the_share(stage):
    result = simulated.physics(stage, SENSOR, draws=5)
    assert 0 < np.count_nonzero(result.ndp) < result.ndp.size
    assert_array_equal(result.reason == Reason.VALID, result.ndp == 0)
    assert_array_equal(np.isnan(result.disparity_px), result.ndp == 1)
    assert_allclose(result.ndp * 5, np.round(result.ndp * 5), atol=1e-6)
    assert 0 <= result.infrared.min() < result.infrared.max() <= 1


def test_a_scene_is_rendered_once(stage, monkeypatch):
    requests = []
    real = simulate.simulate
    monkeypatch.setattr(simulate, "simulate", lambda *a, **k: requests.append(k) or real(*a, **k))
    simulated.physics(stage, SENSOR, draws=3, samples=7)
    assert [call["samples"] for call in requests] == [7]


def _shot(reason: np.ndarray, disparity: float, level: np.ndarray | float) -> types.SimpleNamespace:
    valid = reason == Reason.VALID
    disparity_px = np.where(valid, np.float32(disparity), np.float32(np.nan))
    depth = types.SimpleNamespace(valid=valid, reason=reason, disparity_px=disparity_px)
    infrared = np.broadcast_to(np.asarray(level, np.uint8), reason.shape)
    return types.SimpleNamespace(depth=depth, ir_left=infrared, layers=None)


def summary(shots: Sequence[types.SimpleNamespace]) -> Physics:
    """Physics of synthetic shots."""
    with pytest.MonkeyPatch.context() as patch:
        left = iter(shots)
        patch.setattr(simulate, "simulate", lambda *_, **__: next(left))
        patch.setattr(simulate, "expose", lambda *_, **__: next(left))
        patch.setattr(simulated, "MitsubaScene", types.SimpleNamespace)
        stage = types.SimpleNamespace(scene=None)
        return simulated.physics(stage, SENSOR, draws=len(shots))  # type: ignore[arg-type]


def test_the_most_frequent_reason_wins_and_ties_take_the_first():
    columns = [  # Reasons of four draws, and the expected one.
        ((0, 0, 0, 0), 0),
        ((0, 0, 0, 8), 8),  # Depth is not a reason, even if most frequent.
        ((3, 10, 10, 10), 10),
        ((7, 7, 5, 5), 5),
        ((13, 8, 4, 0), 4),
        ((9, 9, 2, 0), 9),
    ]
    codes = np.array([codes for codes, _ in columns], np.uint32).T[:, None, :]
    result = summary([_shot(reason, 10, 50) for reason in codes])
    assert result.reason.dtype == np.uint32
    assert result.reason[0].tolist() == [report for _, report in columns]
    assert result.ndp[0].tolist() == [0, 0.25, 1, 1, 0.75, 0.75]


def test_disparity_is_the_mean_of_the_draws_with_depth():
    codes = np.array([[0, 3, 3], [0, 0, 3], [0, 0, 3]], np.uint32)[:, None, :]
    shots = [
        _shot(reason, disparity, 50)
        for reason, disparity in zip(codes, (3.0, 6.0, 12.0), strict=True)
    ]
    result = summary(shots)
    assert_array_equal(result.disparity_px[0], np.array([7, 9, np.nan], np.float32))
    assert_array_equal(result.one_draw_px[0], np.array([3, 6, np.nan], np.float32))
    assert result.one_draw_ndp[0].tolist() == [False, True, True]


def test_infrared_is_the_mean_level_above_black_over_full_scale():
    black, ceiling = SENSOR.left.black_level_dn, SENSOR.left.ceiling_dn
    depth = np.zeros((1, 4), np.uint32)
    first = np.array([[0, black, 100, ceiling]])
    second = np.array([[0, black, 50, ceiling]])
    result = summary([_shot(depth, 1, first), _shot(depth, 1, second)])
    expected = [0, 0, (75 - black) / (ceiling - black), 1]
    assert_allclose(result.infrared[0], expected, rtol=1e-6)


def test_contrast_is_deviation_over_mean_of_a_window():
    """Alternating columns of 0 and 1 above black: 5 or 4 of 9 are 1.

    The standard deviation of the window is sqrt(20) / 9 and its mean 5/9 or 4/9. A uniform image
    has no contrast.
    """
    black = round(SENSOR.left.black_level_dn)
    stripes = np.broadcast_to(np.where(np.arange(40) % 2, 255, black), (20, 40))
    depth = np.zeros(stripes.shape, np.uint32)
    result = summary([_shot(depth, 1, stripes)]).contrast[:, 10:30]
    mean = np.where(np.arange(10, 30) % 2, 5, 4)
    assert_allclose(result, np.broadcast_to(np.sqrt(20) / mean, result.shape), rtol=1e-3)
    assert_allclose(summary([_shot(depth, 1, 99)]).contrast, 0, atol=1e-3)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), draws=st.integers(1, 6))
def test_the_images_are_consistent_for_any_draws(seed, draws):
    rng = np.random.default_rng(seed)
    codes = rng.choice([0, 0, 2, 3, 8, 13], (draws, 3, 5)).astype(np.uint32)
    result = summary([_shot(reason, 4.0, 80) for reason in codes])
    assert_array_equal(result.reason == 0, result.ndp == 0)
    assert_array_equal(np.isnan(result.disparity_px), result.ndp == 1)
    assert_allclose(result.ndp, (codes != 0).mean(axis=0), rtol=1e-6)
    where = result.reason > 0
    occurs = (codes == result.reason).any(axis=0)
    assert occurs[where].all()
