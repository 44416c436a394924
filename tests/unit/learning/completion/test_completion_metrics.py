"""Metrics of completed depth: values, missing pixels, regions, pooling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.completion.evaluation.metrics import (
    RATIOS,
    Score,
    Sums,
    average,
    pool,
    score,
    sums,
)
from starling.patterns.errors import InputError

KEYS = (
    *("mae_m", "rmse_m", "absrel", "sqrel", "delta1", "delta2", "delta3"),
    *("delta105", "delta110", "delta125"),
)
TRUTH = np.array([[1.0, 2.0, 4.0, np.nan]], np.float32)
ALL = np.ones((1, 4), bool)


def test_metrics_of_a_hand_computed_example() -> None:
    figures = sums(np.array([[1.08, 1.0, 4.12, 9.0]], np.float32), TRUTH, ALL).figures()
    assert set(figures) == {*KEYS, "pixels", "missing"}
    assert figures["pixels"] == 3 and figures["missing"] == 0
    expected = {
        "mae_m": (0.08 + 1.0 + 0.12) / 3,
        "rmse_m": np.sqrt((0.0064 + 1.0 + 0.0144) / 3),
        "absrel": (0.08 + 0.5 + 0.03) / 3,
        "sqrel": (0.0064 + 0.5 + 0.0036) / 3,
        "delta1": 2 / 3,
        "delta2": 2 / 3,
        "delta3": 2 / 3,
        "delta105": 1 / 3,
        "delta110": 2 / 3,
        "delta125": 2 / 3,
    }
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value, abs=1e-6), name


def test_ratios_are_symmetric() -> None:
    truth = np.full((1, 4), 2.0, np.float32)
    result = np.array([[2 * 1.24, 2 / 1.24, 2 * 1.26, 2 / 1.26]], np.float32)
    assert sums(result, truth, ALL).figures()["delta1"] == 0.5
    assert RATIOS["delta3"] == 1.25**3 and RATIOS["delta125"] == RATIOS["delta1"]


@pytest.mark.parametrize("none", [np.nan, np.inf, 0.0, -1.0])
def test_missing_pixels_fail_deltas_and_are_counted(none: float) -> None:
    figures = sums(np.array([[1.0, none, none, 1.0]], np.float32), TRUTH, ALL).figures()
    assert figures["pixels"] == 3 and figures["missing"] == 2
    assert figures["mae_m"] == 0.0 and figures["delta1"] == pytest.approx(1 / 3)


def test_a_method_without_depth_has_no_error_and_zero_deltas() -> None:
    figures = sums(np.full((1, 4), np.nan, np.float32), TRUTH, ALL).figures()
    assert figures["mae_m"] is None and figures["rmse_m"] is None and figures["delta3"] == 0.0
    assert Sums().figures()["delta1"] is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_pooled_images_have_the_metrics_of_all_pixels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0.5, 5, (2, 6, 8)).astype(np.float32)
    result = truth * rng.uniform(0.7, 1.4, truth.shape).astype(np.float32)
    result[rng.random(truth.shape) < 0.2] = np.nan
    where = rng.random(truth.shape) < 0.6
    parts = sums(result[0], truth[0], where[0]) + sums(result[1], truth[1], where[1])
    whole = sums(*(image.reshape(12, 8) for image in (result, truth, where)))
    assert parts.figures() == pytest.approx(whole.figures())


def scene(result: float = 2.0) -> Score:
    """A wall at 2 m, a post at 1 m, holes left of the post."""
    truth = np.full((20, 40), 2.0, np.float32)
    truth[:, 20:25] = 1.0
    valid = np.ones(truth.shape, bool)
    valid[:, 15:20] = False
    causes = {"occluded": ~valid, "unknown": valid}
    depth = np.where(valid, truth, np.float32(result))
    return score(depth, truth, valid, focal_baseline_px_m=50.0, causes=causes)


def test_regions_partition_the_image() -> None:
    item = scene()
    assert item.all.pixels == 800 and item.hole.pixels == 100 and item.valid.pixels == 700
    assert item.hole + item.valid == item.all
    assert item.edge.pixels == 20 * 11  # Two edges: columns 17 to 22 and 22 to 27.
    assert item.reasons["occluded"] == item.hole and item.reasons["unknown"].pixels == 0
    figures = item.figures()
    assert set(figures) == {"all", "hole", "valid", "edge", "reasons"}
    assert scene(1.0).hole.figures()["mae_m"] == 1.0 and scene(1.0).valid.figures()["mae_m"] == 0


def test_edges_follow_the_camera() -> None:
    """The same step is not an edge for a camera with a tenth of the baseline."""
    truth = np.full((20, 40), 2.0, np.float32)
    truth[:, 20:] = 1.9
    seen = [
        score(truth, truth, truth > 0, focal_baseline_px_m=fb).edge.pixels for fb in (50.0, 5.0)
    ]
    assert seen == [20 * 6, 0]


def test_pooling_counts_pixels_and_averaging_counts_images() -> None:
    good, bad = scene(2.0), scene(1.0)
    both = pool([good, good, bad])
    assert both.hole.figures()["mae_m"] == pytest.approx(1 / 3)
    assert both.reasons["occluded"].pixels == 300
    rooms = average([(good + good).hole, bad.hole])
    assert rooms["mae_m"] == pytest.approx(0.5)
    assert rooms["pixels"] == 300 and rooms["missing"] == 0
    assert average([good.hole, Sums()])["delta1"] == 1.0
    assert average([])["delta1"] is None


def test_causes_of_only_one_image_are_kept() -> None:
    only = Score(reasons={"speckle": Sums(pixels=3)})
    assert (scene() + only).reasons["speckle"].pixels == 3


def test_metrics_refuse() -> None:
    with pytest.raises(InputError, match="depth_m, truth_m and where must share one shape"):
        sums(TRUTH[:, :2], TRUTH, ALL)
    with pytest.raises(InputError, match="truth_m must be > 0 where known; got 0"):
        sums(TRUTH, np.zeros((1, 4), np.float32), ALL)
    with pytest.raises(InputError, match="focal_baseline_px_m must be > 0"):
        score(TRUTH, TRUTH, ALL, focal_baseline_px_m=0.0)
