"""Error figures of a disparity map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim import metrics


def step_scene() -> np.ndarray:
    truth = np.full((40, 300), 10, np.float32)
    truth[:, 200:] = 14
    return truth


def test_edges_reach_two_pixels_and_holes_are_no_edges():
    truth = step_scene()
    truth[5:9, 150:160] = np.nan
    np.testing.assert_array_equal(
        np.unique(np.nonzero(metrics.depth_edges(truth))[1]), range(197, 203)
    )
    assert not metrics.depth_edges(np.full((5, 5), np.nan)).any()
    vertical = metrics.depth_edges(step_scene().T)
    np.testing.assert_array_equal(np.unique(np.nonzero(vertical)[0]), range(197, 203))


def test_scored_pixels_are_known_right_of_the_band_and_off_the_edges():
    truth = step_scene()
    truth[0, 140] = np.nan
    scored = metrics.scored_pixels(truth)
    assert not scored[:, :128].any()
    assert not scored[0, 140]
    assert not scored[:, 197:203].any()
    assert scored.sum() == 40 * (300 - 128 - 6) - 1
    assert metrics.reached_pixels(truth).sum() == 40 * (300 - 128) - 1


@given(bias=st.floats(-3, 3), sigma=st.floats(0.05, 0.5), seed=st.integers(0, 9))
def test_figures_recover_bias_and_spread(bias, sigma, seed):
    truth = np.full((60, 400), 20.0)
    noise = np.random.default_rng(seed).normal(bias, sigma, truth.shape)
    figures = metrics.disparity_figures(truth + noise, truth, metrics.scored_pixels(truth))
    assert figures.bias_px == pytest.approx(bias, abs=0.03)
    assert figures.nmad_px == pytest.approx(sigma, rel=0.05)
    assert figures.fill == 1.0
    assert figures.ndp_iou is None


def test_bad_fill_and_overlap_count_pixels():
    truth = np.full((10, 228), 5.0)
    ours, device = truth.copy(), truth.copy()
    ours[:, 128:138] += 2
    ours[:, 208:] = np.nan
    device[:, 218:] = np.nan
    figures = metrics.disparity_figures(
        ours, truth, metrics.scored_pixels(truth), holes_of_px=device,
        holes_where=metrics.reached_pixels(truth),
    )  # fmt: skip
    assert figures.bad1_pct == pytest.approx(12.5)
    assert figures.fill == pytest.approx(0.8)
    assert figures.ndp_iou == pytest.approx(0.5)
    alone = metrics.disparity_figures(truth, truth, metrics.scored_pixels(truth), holes_of_px=truth)
    assert alone.ndp_iou == 1.0


def test_no_valid_pixel_gives_nan_and_no_fill():
    truth = np.full((10, 228), 5.0)
    figures = metrics.disparity_figures(truth * np.nan, truth, metrics.scored_pixels(truth))
    assert np.isnan([figures.bias_px, figures.nmad_px, figures.bad1_pct]).all()
    assert figures.fill == 0


def test_what_cannot_be_compared_is_refused():
    truth = np.full((10, 228), 5.0)
    scored = metrics.scored_pixels(truth)
    with pytest.raises(InputError, match="must share one shape; got"):
        metrics.disparity_figures(truth[:5], truth, scored)
    with pytest.raises(InputError, match="scored must hold a pixel; got 0"):
        metrics.disparity_figures(truth, truth, np.zeros(truth.shape, bool))
    with pytest.raises(InputError, match="must share one shape"):
        metrics.disparity_figures(truth, truth, scored, holes_of_px=truth[:5])


def test_errors_below_are_bad_and_holes_count_where_asked() -> None:
    reference = np.full((4, 200), 10.0)
    ours = reference.copy()
    ours[0, :50], ours[3, 0] = 8.0, np.nan
    scored, everywhere = np.ones(reference.shape, bool), np.ones(reference.shape, bool)
    scored[3] = False
    whole = metrics.disparity_figures(
        ours, reference, scored, holes_of_px=reference, holes_where=everywhere
    )
    assert whole.bad1_pct == pytest.approx(100 * 50 / 600)
    assert whole.ndp_iou == 0.0
    part = metrics.disparity_figures(ours, reference, scored, holes_of_px=reference)
    assert part.ndp_iou == 1.0
