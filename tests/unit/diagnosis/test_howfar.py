"""Distances between observations, and the gap reduction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from starling.diagnosis.howfar.distances import hole_figures, scene_distances
from starling.diagnosis.howfar.reduction import gap_reductions
from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND, strata_of

ROOMS = ("hall", "attic", "porch")


def reading(
    seed: int, *, noise_px: float = 0.1, bias_px: float = 0.0, level: float = 1.0, frames: int = 1
) -> StereoObservation:
    """Return images and maps of the synthetic scene; a fixed corner has no depth."""
    rng = np.random.default_rng(seed)
    shape = (frames, *DISPARITY.shape)
    maps = DISPARITY + bias_px + noise_px * rng.standard_normal(shape)
    maps[:, :40, -60:] = np.nan
    images = np.clip(level * EXPECTED + 2 * rng.standard_normal(shape), 0, 255)
    codes = np.rint(images).astype(np.uint8)
    return StereoObservation(left=codes, right=codes, ours_px=maps.astype(np.float32))


BASE = [reading(seed) for seed in range(1, 5)]


def test_two_observations_of_one_camera_are_close():
    result = scene_distances(
        reading(9, frames=3), [reading(s, frames=3) for s in (1, 2, 3)], GROUND
    )
    assert result["ndp_1_auc"] < 1e-3 and result["ndp_1_iou"] == 0 and result["ndp_brier"] < 0.01
    assert result["bias_px"] < 0.005 and result["log_nmad"] < 0.05
    assert result["error_distribution_px"] < 0.01
    assert result["dot_contrast"] < 0.01 and result["log_noise_in_time"] < 0.05
    assert "log_noise_in_time" not in scene_distances(reading(9), BASE, GROUND)


@pytest.mark.parametrize(
    ("how", "figure", "value", "abs_tol"),
    [
        ({"bias_px": 0.2}, "bias_px", 0.2, 0.01),
        ({"bias_px": 0.2}, "error_distribution_px", 0.2, 0.01),
        ({"noise_px": 0.2}, "log_nmad", np.log(2), 0.05),
    ],
)
def test_distances_equal_the_change(how, figure, value, abs_tol):
    result = scene_distances(reading(9, **how), BASE, GROUND)
    assert result[figure] == pytest.approx(value, abs=abs_tol)


def test_other_light_is_less_likely():
    near = scene_distances(reading(9), BASE, GROUND)
    far = scene_distances(reading(9, level=1.2), BASE, GROUND)
    assert far["infrared_nll"] > near["infrared_nll"] + 0.5


def test_device_depth_takes_precedence():
    real = reading(9)
    device = real.with_depth(real.ours_px + 1)
    assert scene_distances(device, BASE, GROUND)["bias_px"] == pytest.approx(1, abs=0.01)
    assert scene_distances(real, BASE, GROUND)["bias_px"] < 0.01


def test_too_few_pixels_have_no_errors():
    nothing = np.full_like(DISPARITY, np.nan)[None]
    real = DepthObservation(device_px=nothing)
    result = scene_distances(real, BASE, GROUND)
    assert np.isnan(result["bias_px"]) and np.isnan(result["ndp_1_auc"])
    flat = strata_of(np.full_like(DISPARITY, 5.0))
    assert scene_distances(real, BASE, flat)["ndp_1_iou"] > 0.8


def test_gap_reduction_is_a_ratio_of_sums():
    before = [{"a": 2.0}, {"a": 3.0}, {"a": 2.5}]
    after = [{"a": 0.5}, {"a": 0.5}, {"a": 0.5}]
    floor = [{"a": 0.0}, {"a": 0.0}, {"a": 0.0}]
    (result,) = gap_reductions(before, after, floor, ROOMS).values()
    assert result.closed_pct == pytest.approx(100 * 6 / 7.5)
    assert result.interval is not None and result.interval[0] <= 80 <= result.interval[1]
    assert (result.before, result.after, result.floor) == (2.5, 0.5, 0)


def test_scenes_of_a_room_are_resampled_together():
    """Scenes of a room are resampled together; two rooms give no interval.

    Four scenes share a room without a reduction; two other rooms have one scene each.
    """
    before, floor = [{"a": 1.0}] * 6, [{"a": 0.0}] * 6
    after = [{"a": 1.0}] * 4 + [{"a": 0.0}] * 2
    (result,) = gap_reductions(before, after, floor, ["hall"] * 4 + ["attic", "yard"]).values()
    assert result.closed_pct == pytest.approx(100 / 3)
    wider = np.sqrt(3 / 2) * stats.t.isf(0.025, 2) / stats.norm.isf(0.025)
    third = 100 / 3
    ends = (third - wider * third, third + wider * (100 - third))
    assert result.interval == pytest.approx(ends)
    (result,) = gap_reductions(before, after, floor, ["hall"] * 4 + ["attic"] * 2).values()
    assert result.closed_pct == pytest.approx(100 / 3) and result.interval is None


def test_figure_is_reported_for_scenes_that_have_it():
    """For example temporal noise, which only scenes with repeats have, in any order."""
    plain, with_repeats = {"a": 1.0}, {"a": 1.0, "b": 2.0}
    for many in ([plain, with_repeats], [with_repeats, plain]):
        half = [{name: value / 2 for name, value in each.items()} for each in many]
        none = [dict.fromkeys(each, 0.0) for each in many]
        result = gap_reductions(many, half, none, ROOMS[:2])
        assert result["a"].closed_pct == result["b"].closed_pct == pytest.approx(50)
        assert result["b"].before == 2


def test_one_room_must_have_a_gap_in_every_scene():
    before, after, floor = [{"a": 1.0}, {"a": 0.1}], [{"a": 0.5}] * 2, [{"a": 0.2}] * 2
    (result,) = gap_reductions(before, after, floor, ["hall"] * 2).values()
    assert result.closed_pct is None


def test_no_gap_is_not_identifiable():
    same = [{"a": 1.0}, {"a": 2.0}, {"a": 0.5}]
    shuffled = [{"a": 2.0}, {"a": 1.0}, {"a": 0.5}]
    (result,) = gap_reductions(same, shuffled, shuffled, ROOMS).values()
    assert result.closed_pct is None and result.interval is None


def test_few_rooms_rarely_show_a_gap_by_chance():
    """All three rooms are above the floor by chance in 1 of 8 draws; 2.5 % may be significant."""
    rng = np.random.default_rng(0)
    zero = [{"a": 0.0}] * 3
    shown = 0
    for _ in range(400):
        before = [{"a": float(value)} for value in rng.standard_normal(3)]
        shown += gap_reductions(before, zero, zero, ROOMS[:3])["a"].closed_pct is not None
    assert 0 < shown / 400 < 0.05


def test_one_scene_has_no_interval():
    (result,) = gap_reductions([{"a": 2.0}], [{"a": 1.0}], [{"a": 0.0}], ROOMS[:1]).values()
    assert result.closed_pct == pytest.approx(50) and result.interval is None


def test_scenes_without_a_figure_are_left_out():
    nan = float("nan")
    before, after, floor = ([{"a": v}, {"a": nan}, {"a": v}] for v in (2.0, 1.0, 0.0))
    assert gap_reductions(before, after, floor, ROOMS)["a"].closed_pct == pytest.approx(50)
    assert gap_reductions([{"a": nan}], [{"a": 1.0}], [{"a": 0.0}], ROOMS[:1]) == {}


def of_levels(images: np.ndarray, seed: int = 0) -> StereoObservation:
    return StereoObservation(left=images, right=images, ours_px=reading(seed).ours_px)


def test_temporal_noise_is_a_log_ratio():
    rng = np.random.default_rng(0)
    shape = (4, *DISPARITY.shape)

    def noisy(sigma: float) -> StereoObservation:
        return of_levels(np.rint(100 + sigma * rng.standard_normal(shape)).astype(np.uint8))

    simulated = [noisy(4.0) for _ in range(3)]
    for sigma in (8.0, 2.0):
        result = scene_distances(noisy(sigma), simulated, GROUND)
        assert result["log_noise_in_time"] == pytest.approx(np.log(2), abs=0.03)


def test_dot_contrast_is_a_difference():
    dots = GROUND.covariates["dots"]
    on, between = dots.mask("on dots"), dots.mask("between")

    def lit(dot: int, rest: int) -> StereoObservation:
        image = np.select([on, between], [dot, rest], 50)[None].astype(np.uint8)
        return of_levels(image)

    result = scene_distances(lit(60, 40), [lit(90, 30) for _ in range(2)], GROUND)
    assert result["dot_contrast"] == pytest.approx(60 / 120 - 20 / 100, abs=1e-6)


def test_likelihood_of_infrared_is_that_of_its_own_noise():
    """For normal pixels with the draws' variance it is (log 2 pi sigma^2 + 1) / 2 per pixel."""
    rng = np.random.default_rng(0)
    ramp = np.linspace(60, 120, DISPARITY.shape[1]) * np.ones(DISPARITY.shape)

    def taken(sigma: float) -> StereoObservation:
        image = ramp + sigma * rng.standard_normal(ramp.shape)
        return of_levels(np.rint(image)[None].astype(np.uint8))

    draws = [taken(5.0) for _ in range(24)]
    variance = 25 + 1 / 12
    for sigma in (5.0, 10.0):
        result = scene_distances(taken(sigma), draws, GROUND)["infrared_nll"]
        off = (sigma**2 + 1 / 12 + variance / 24) / variance
        assert result == pytest.approx(0.5 * (np.log(2 * np.pi * variance) + off), abs=0.02)


def test_a_calibrated_guess_has_a_brier_score_and_no_calibration_error():
    real = np.zeros((10, 100), bool)
    real[:3] = True
    result = hole_figures(np.full(real.shape, 0.3, np.float32), real, np.ones(real.shape, bool))
    assert result["ndp_brier"] == pytest.approx(0.21, abs=1e-4)
    assert result["ndp_ece"] == pytest.approx(0.0, abs=1e-4)
