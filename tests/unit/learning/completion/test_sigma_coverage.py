"""Coverage by a predicted standard deviation and by intervals, and ignored pixels."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.completion.evaluation.coverage import (
    Coverage,
    coverage,
    coverage_by_region,
    pooled,
)
from starling.learning.completion.method import Completed

SHAPE = (200, 300)
ALL = np.ones(SHAPE, bool)
TRUTH = np.full(SHAPE, 2.0, np.float32)
SIGMA = np.full(SHAPE, 0.1, np.float32)


@pytest.mark.parametrize(
    ("kind", "share", "share_2", "median"),
    [("normal", 0.6827, 0.9545, 0.6745), ("laplace", 0.7569, 0.9409, 0.4901)],
)
def test_coverage_of_normal_and_laplace_errors(kind, share, share_2, median):
    """60,000 pixels determine a share to 0.002; bins of the median are 2.3 % wide."""
    rng = np.random.default_rng(0)
    scale = 0.1 if kind == "normal" else 0.1 / np.sqrt(2)
    depth = (TRUTH + getattr(rng, kind)(0, scale, SHAPE)).astype(np.float32)
    report = coverage(depth, SIGMA, TRUTH, ALL).figures()
    assert report["within_sigma"] == pytest.approx(share, abs=0.007)
    assert report["within_2_sigma"] == pytest.approx(share_2, abs=0.004)
    assert report["rms_over_sigma"] == pytest.approx(1, abs=0.02)
    assert report["median_over_sigma"] == pytest.approx(median, rel=0.03)
    half = coverage(depth, SIGMA / 2, TRUTH, ALL).figures()
    assert half["rms_over_sigma"] == pytest.approx(2, abs=0.04)
    assert half["within_2_sigma"] == report["within_sigma"]


def test_intervals_count_where_they_are_known():
    rng = np.random.default_rng(1)
    depth = (TRUTH + rng.normal(0, 0.1, SHAPE)).astype(np.float32)
    halves = {68: 0.9945 * SIGMA, 95: 1.96 * SIGMA}
    for half in halves.values():
        half[100:] = np.nan
    report = coverage(depth, SIGMA, TRUTH, ALL, halves).figures()
    assert report["interval_68"] == pytest.approx(0.68, abs=0.01)
    assert report["interval_95"] == pytest.approx(0.95, abs=0.01)
    assert report["pixels"] == SHAPE[0] * SHAPE[1]
    unknown = coverage(depth, SIGMA, TRUTH, ALL).figures()
    assert unknown["interval_68"] is None and unknown["interval_95"] is None


@pytest.mark.parametrize("ratio", [0, 1e6])
def test_the_median_of_ratios_beyond_the_bins_is_their_end(ratio):
    depth = TRUTH + np.float32(ratio) * SIGMA
    report = coverage(depth, SIGMA, TRUTH, ALL).figures()
    assert report["median_over_sigma"] == pytest.approx(1e-3 if ratio == 0 else 1e3)


def test_unknown_pixels_are_ignored_and_counts_add_up():
    depth, sigma, truth = TRUTH + np.float32(0.05), SIGMA.copy(), TRUTH.copy()
    depth[0], sigma[1], truth[2], sigma[3] = np.nan, np.nan, np.nan, 0
    whole = coverage(depth, sigma, truth, ALL)
    assert whole.pixels == whole.within == (SHAPE[0] - 4) * SHAPE[1]
    upper = np.arange(SHAPE[0])[:, None] < 100
    parts = [coverage(depth, sigma, truth, ALL & item) for item in (upper, ~upper)]
    total = parts[0] + parts[1]
    assert (total.pixels, total.within) == (whole.pixels, whole.within)
    assert total.square == pytest.approx(whole.square)
    np.testing.assert_array_equal(total.bins, whole.bins)
    empty = Coverage().figures()
    assert empty.pop("pixels") == 0 and set(empty.values()) == {None}


def test_regions_are_holes_valid_pixels_and_causes():
    valid = np.arange(SHAPE[1])[None] + np.zeros(SHAPE) >= 40
    dark = np.arange(SHAPE[0])[:, None] + np.zeros(SHAPE) < 50
    completed = Completed(depth_m=TRUTH, sigma_m=SIGMA)
    regions = coverage_by_region(completed, TRUTH, valid, {"dark": dark})
    counts = {name: part.pixels for name, part in regions.items()}
    assert counts == {"hole": 200 * 40, "valid": 200 * 260, "hole, dark": 50 * 40}
    both = pooled([regions, {"hole": regions["hole"]}])
    assert both["hole"].pixels == 2 * counts["hole"]
    assert both["valid"].pixels == counts["valid"]
