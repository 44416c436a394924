"""Readings of features over the whole range of the effects that they are meant for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.features import bins
from starling.diagnosis.features import depth as depth_maps
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

NOISE_PX = 0.1
SEARCH_PX = 128.0  # Range of wrong matches.
BIAS_TOLERANCE_PX = 0.02


def measured(bias_px: float, wrong: float) -> np.ndarray:
    """Return biased disparity with noise, and wrong matches anywhere in the search range."""
    rng = np.random.default_rng(4)
    noisy = DISPARITY + NOISE_PX * rng.standard_normal(DISPARITY.shape) + bias_px
    anywhere = rng.uniform(0, SEARCH_PX, DISPARITY.shape)
    return np.where(rng.random(DISPARITY.shape) < wrong, anywhere, noisy).astype(np.float32)


@settings(max_examples=30)
@given(bias=st.floats(-5, 5), wrong=st.sampled_from([0.0, 0.3, 0.7]))
def test_a_bias_is_read_over_the_whole_range_despite_wrong_matches(bias: float, wrong: float):
    """Scale errors of 3 % move near disparities by more than 2 px, where matches count as wrong."""
    features = depth_maps.disparity_features(measured(bias, wrong), GROUND)
    for name in ("error.bias.all", "error.bias.x.left"):
        assert features[name] == pytest.approx(bias, abs=BIAS_TOLERANCE_PX)
    assert features["error.spread.all"] == pytest.approx(np.log(NOISE_PX), abs=0.4 * wrong + 0.1)
    assert features["error.fraction.fraction.0/8"] == pytest.approx(0, abs=BIAS_TOLERANCE_PX)


def test_foreground_that_grows_over_an_edge_is_a_wrong_match():
    """It is as frequent as true depth there, but not on the surfaces."""
    grown = measured(0.1, 0.0)
    mask = GROUND.covariates["edge"].mask("beside a nearer thing")
    grown[mask & (np.random.default_rng(1).random(grown.shape) < 0.6)] += 4
    features = depth_maps.disparity_features(grown, GROUND)
    assert features["error.bias.edge.beside a nearer thing"] == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_the_roughness_of_a_surface_does_not_depend_on_its_bias(bias: float):
    near, far = (depth_maps.surface_features(measured(b, 0.1), GROUND) for b in (0.0, bias))
    for name in ("surface.alike x1", "surface.rough x"):
        assert far[name] == pytest.approx(near[name], abs=0.02)


def test_a_difference_from_our_matcher_has_no_fold():
    ours = measured(0.0, 0.0)
    for bias in (0.5, 1.9, 2.1, 5.0):
        features = depth_maps.bias_features(measured(bias, 0.0), ours, GROUND)
        assert features["against.bias.all"] == pytest.approx(bias, abs=BIAS_TOLERANCE_PX)


def test_a_crowd_beyond_the_farthest_value_is_unknown():
    where = np.arange(1000)
    for value in (bins.FARTHEST + 8.0, -bins.FARTHEST - 8.0):
        assert np.isnan(bins.crowd_median_and_spread(np.full(1000, value), where, 2.0)).all()
    assert bins.crowd_median_and_spread(np.full(1000, 5.5), where, 2.0)[0] == 5.5
    anywhere = np.random.default_rng(0).uniform(-40, 40, 1000)
    assert np.isnan(bins.crowd_median_and_spread(anywhere, where, 2.0)).all()
    assert np.isnan(bins.crowd_median_and_spread(np.zeros(50), np.arange(50), 2.0)).all()


@pytest.mark.parametrize("step_px", [0.0, 0.0625, 0.25])
def test_roughness_rises_steadily_with_the_share_of_rough_pixels(step_px: float):
    """Most pixels of a quantised plane are smooth, and their median says nothing of the others."""
    rng = np.random.default_rng(5)
    noise = 0.2 * rng.standard_normal(DISPARITY.shape)
    order = rng.random(DISPARITY.shape)
    readings = []
    for share in np.linspace(0, 1, 9):
        rough = DISPARITY + np.where(order < share, noise, 0)
        quantised = np.round(rough / step_px) * step_px if step_px else rough
        features = depth_maps.surface_features(quantised.astype(np.float32), GROUND)
        readings.append(features["surface.rough x"])
    assert (np.diff(readings) > 0).all()
    assert np.diff(readings)[1:].max() < 1


def test_a_spread_is_bounded_below():
    where = np.arange(1000)
    assert bins.spread(np.zeros(1000), where) == pytest.approx(np.log(1e-3))
