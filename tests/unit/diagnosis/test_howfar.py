"""Distances between readings, and the share of a gap that is closed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from starling.diagnosis.howfar.distances import distances
from starling.diagnosis.howfar.holes import figures
from starling.diagnosis.howfar.reduction import closed
from starling.diagnosis.scenes.observation import Reading
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND, made

ROOMS = ("hall", "attic", "porch")


def reading(
    seed: int, *, noise_px: float = 0.1, bias_px: float = 0.0, level: float = 1.0, frames: int = 1
) -> Reading:
    """Images and maps of the made world; one corner, always the same, has no depth."""
    rng = np.random.default_rng(seed)
    shape = (frames, *DISPARITY.shape)
    maps = DISPARITY + bias_px + noise_px * rng.standard_normal(shape)
    maps[:, :40, -60:] = np.nan
    images = np.clip(level * EXPECTED + 2 * rng.standard_normal(shape), 0, 255)
    codes = np.rint(images).astype(np.uint8)
    return Reading(left=codes, right=codes, ours_px=maps.astype(np.float32), device_px=None)


BASE = [reading(seed) for seed in range(1, 5)]


def test_two_readings_of_one_camera_are_near():
    found = distances(reading(9, frames=3), [reading(s, frames=3) for s in (1, 2, 3)], GROUND)
    assert found["ndp_1_auc"] < 1e-3 and found["ndp_1_iou"] == 0 and found["ndp_brier"] < 0.01
    assert found["bias_px"] < 0.005 and found["log_nmad"] < 0.05
    assert found["error_distribution_px"] < 0.01
    assert found["dot_contrast"] < 0.01 and found["log_noise_in_time"] < 0.05
    assert "log_noise_in_time" not in distances(reading(9), BASE, GROUND)


@pytest.mark.parametrize(
    ("how", "figure", "value", "abs_tol"),
    [
        ({"bias_px": 0.2}, "bias_px", 0.2, 0.01),
        ({"bias_px": 0.2}, "error_distribution_px", 0.2, 0.01),
        ({"noise_px": 0.2}, "log_nmad", np.log(2), 0.05),
    ],
)
def test_distances_have_the_size_of_what_was_changed(how, figure, value, abs_tol):
    found = distances(reading(9, **how), BASE, GROUND)
    assert found[figure] == pytest.approx(value, abs=abs_tol)


def test_other_light_is_less_likely():
    near = distances(reading(9), BASE, GROUND)
    far = distances(reading(9, level=1.2), BASE, GROUND)
    assert far["infrared_nll"] > near["infrared_nll"] + 0.5


def test_the_device_s_own_depth_is_compared_where_there_is_any():
    real = reading(9)
    device = Reading(
        left=real.left, right=real.right, ours_px=real.ours_px, device_px=real.ours_px + 1
    )
    assert distances(device, BASE, GROUND)["bias_px"] == pytest.approx(1, abs=0.01)
    assert distances(real, BASE, GROUND)["bias_px"] < 0.01


def test_too_few_pixels_have_no_errors():
    nothing = np.full_like(DISPARITY, np.nan)[None]
    real = Reading(left=None, right=None, ours_px=nothing, device_px=None)
    found = distances(real, BASE, GROUND)
    assert np.isnan(found["bias_px"]) and np.isnan(found["ndp_1_auc"])
    flat = made(np.full_like(DISPARITY, 5.0))
    assert distances(real, BASE, flat)["ndp_1_iou"] > 0.8


def test_closed_is_a_ratio_of_sums():
    before = [{"a": 2.0}, {"a": 3.0}, {"a": 2.5}]
    after = [{"a": 0.5}, {"a": 0.5}, {"a": 0.5}]
    floor = [{"a": 0.0}, {"a": 0.0}, {"a": 0.0}]
    (found,) = closed(before, after, floor, ROOMS).values()
    assert found.closed_pct == pytest.approx(100 * 6 / 7.5)
    assert found.interval is not None and found.interval[0] <= 80 <= found.interval[1]
    assert (found.before, found.after, found.floor) == (2.5, 0.5, 0)


def test_scenes_of_one_room_are_drawn_together():
    """Four of a room whose gap does not close, one each of two others: a draw may have any alone.

    Of two rooms nothing is said of how sure that is.
    """
    before, floor = [{"a": 1.0}] * 6, [{"a": 0.0}] * 6
    after = [{"a": 1.0}] * 4 + [{"a": 0.0}] * 2
    (found,) = closed(before, after, floor, ["hall"] * 4 + ["attic", "yard"]).values()
    assert found.closed_pct == pytest.approx(100 / 3)
    wider = np.sqrt(3 / 2) * stats.t.isf(0.025, 2) / stats.norm.isf(0.025)
    third = 100 / 3
    ends = (third - wider * third, third + wider * (100 - third))
    assert found.interval == pytest.approx(ends)
    (found,) = closed(before, after, floor, ["hall"] * 4 + ["attic"] * 2).values()
    assert found.closed_pct == pytest.approx(100 / 3) and found.interval is None


def test_a_figure_that_some_scenes_lack_is_told_of_the_others():
    """As noise in time of scenes with repeats, whichever scene comes first."""
    one, other = {"a": 1.0}, {"a": 1.0, "b": 2.0}
    for many in ([one, other], [other, one]):
        half = [{name: value / 2 for name, value in each.items()} for each in many]
        none = [dict.fromkeys(each, 0.0) for each in many]
        found = closed(many, half, none, ROOMS[:2])
        assert found["a"].closed_pct == found["b"].closed_pct == pytest.approx(50)
        assert found["b"].before == 2


def test_one_room_must_have_a_gap_in_every_scene():
    before, after, floor = [{"a": 1.0}, {"a": 0.1}], [{"a": 0.5}] * 2, [{"a": 0.2}] * 2
    (found,) = closed(before, after, floor, ["hall"] * 2).values()
    assert found.closed_pct is None


def test_a_gap_that_is_none_is_not_identifiable():
    same = [{"a": 1.0}, {"a": 2.0}, {"a": 0.5}]
    other = [{"a": 2.0}, {"a": 1.0}, {"a": 0.5}]
    (found,) = closed(same, other, other, ROOMS).values()
    assert found.closed_pct is None and found.interval is None


def test_where_there_is_no_gap_few_rooms_rarely_show_one():
    """All of three rooms are above their floor by chance in one draw of eight: 2.5 % are asked."""
    rng = np.random.default_rng(0)
    zero = [{"a": 0.0}] * 3
    shown = 0
    for _ in range(400):
        before = [{"a": float(one)} for one in rng.standard_normal(3)]
        shown += closed(before, zero, zero, ROOMS[:3])["a"].closed_pct is not None
    assert 0 < shown / 400 < 0.05


def test_one_scene_has_no_interval():
    (found,) = closed([{"a": 2.0}], [{"a": 1.0}], [{"a": 0.0}], ROOMS[:1]).values()
    assert found.closed_pct == pytest.approx(50) and found.interval is None


def test_scenes_without_a_figure_are_left_out():
    nan = float("nan")
    before, after, floor = ([{"a": v}, {"a": nan}, {"a": v}] for v in (2.0, 1.0, 0.0))
    assert closed(before, after, floor, ROOMS)["a"].closed_pct == pytest.approx(50)
    assert closed([{"a": nan}], [{"a": 1.0}], [{"a": 0.0}], ROOMS[:1]) == {}


def of_levels(images: np.ndarray, seed: int = 0) -> Reading:
    return Reading(left=images, right=images, ours_px=reading(seed).ours_px, device_px=None)


def test_noise_in_time_is_the_logarithm_of_a_ratio():
    rng = np.random.default_rng(0)
    shape = (4, *DISPARITY.shape)

    def noisy(sigma: float) -> Reading:
        return of_levels(np.rint(100 + sigma * rng.standard_normal(shape)).astype(np.uint8))

    simulated = [noisy(4.0) for _ in range(3)]
    for sigma in (8.0, 2.0):
        found = distances(noisy(sigma), simulated, GROUND)
        assert found["log_noise_in_time"] == pytest.approx(np.log(2), abs=0.03)


def test_contrast_of_dots_is_the_difference_of_both_contrasts():
    dots = GROUND.covariates["dots"]
    on, between = dots.where("on dots"), dots.where("between")

    def lit(dot: int, rest: int) -> Reading:
        image = np.select([on, between], [dot, rest], 50)[None].astype(np.uint8)
        return of_levels(image)

    found = distances(lit(60, 40), [lit(90, 30) for _ in range(2)], GROUND)
    assert found["dot_contrast"] == pytest.approx(60 / 120 - 20 / 100, abs=1e-6)


def test_likelihood_of_infrared_is_that_of_its_own_noise():
    """Law: of normal pixels with the draws' variance it is (log 2 pi sigma^2 + 1) / 2 each."""
    rng = np.random.default_rng(0)
    ramp = np.linspace(60, 120, DISPARITY.shape[1]) * np.ones(DISPARITY.shape)

    def taken(sigma: float) -> Reading:
        image = ramp + sigma * rng.standard_normal(ramp.shape)
        return of_levels(np.rint(image)[None].astype(np.uint8))

    draws = [taken(5.0) for _ in range(24)]
    variance = 25 + 1 / 12
    for sigma in (5.0, 10.0):
        found = distances(taken(sigma), draws, GROUND)["infrared_nll"]
        off = (sigma**2 + 1 / 12 + variance / 24) / variance
        assert found == pytest.approx(0.5 * (np.log(2 * np.pi * variance) + off), abs=0.02)


def test_a_calibrated_guess_has_a_brier_score_and_no_calibration_error():
    real = np.zeros((10, 100), bool)
    real[:3] = True
    found = figures(np.full(real.shape, 0.3, np.float32), real, np.ones(real.shape, bool))
    assert found["ndp_brier"] == pytest.approx(0.21, abs=1e-4)
    assert found["ndp_ece"] == pytest.approx(0.0, abs=1e-4)
