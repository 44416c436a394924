"""Coverage by a predicted standard deviation: normal and Laplace errors, and ignored pixels."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.completion.evaluation.metrics import Coverage, coverage

SHAPE = (200, 300)
ALL = np.ones(SHAPE, bool)
TRUTH = np.full(SHAPE, 2.0, np.float32)
SIGMA = np.full(SHAPE, 0.1, np.float32)


@pytest.mark.parametrize(("kind", "share"), [("normal", 0.6827), ("laplace", 0.7569)])
def test_coverage_of_normal_and_laplace_errors(kind, share):
    """60,000 pixels determine a share to 0.002."""
    rng = np.random.default_rng(0)
    scale = 0.1 if kind == "normal" else 0.1 / np.sqrt(2)
    depth = (TRUTH + getattr(rng, kind)(0, scale, SHAPE)).astype(np.float32)
    report = coverage(depth, SIGMA, TRUTH, ALL).figures()
    assert report["within_sigma"] == pytest.approx(share, abs=0.007)
    assert report["rms_over_sigma"] == pytest.approx(1, abs=0.02)
    half = coverage(depth, SIGMA / 2, TRUTH, ALL).figures()
    assert half["rms_over_sigma"] == pytest.approx(2, abs=0.04)


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
    assert Coverage().figures() == {"within_sigma": None, "rms_over_sigma": None, "pixels": 0}
