"""Recalibration inverts a change of true probabilities and keeps the ranking."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit

from starling.learning.methods.recalibration import Recalibration, fit_recalibration
from starling.patterns.errors import InputError


@given(slope=st.floats(0.5, 3), offset=st.floats(-1, 1))
def test_slope_and_offset_are_recovered(slope, offset):
    """Weights are the true probabilities, so that nothing is random and the result is exact."""
    true = np.linspace(0.02, 0.98, 49)
    report = expit((logit(true) - offset) / slope)
    ndp = np.repeat([True, False], len(true))
    result = fit_recalibration(np.tile(report, 2), ndp, np.concatenate([true, 1 - true]))
    assert result.slope == pytest.approx(slope, rel=1e-5)
    assert result.offset == pytest.approx(offset, abs=1e-5)
    np.testing.assert_allclose(result(report), true, atol=1e-6)


def test_it_equals_the_logistic_regression_of_scikit_learn():
    from sklearn.linear_model import LogisticRegression

    rng = np.random.default_rng(0)
    report, weight = rng.uniform(0.01, 0.99, 2000), rng.uniform(0.1, 3, 2000)
    ndp = rng.random(2000) < report**2
    theirs = LogisticRegression(C=np.inf, tol=1e-9, max_iter=1000)
    theirs.fit(logit(report)[:, None], ndp, sample_weight=weight)
    ours = fit_recalibration(report, ndp, weight)
    assert ours.slope == pytest.approx(theirs.coef_[0, 0], rel=1e-4)
    assert ours.offset == pytest.approx(theirs.intercept_[0], rel=1e-4)


def test_uninformative_probabilities_become_the_share():
    result = fit_recalibration(np.full(10, 0.5), np.arange(10) < 2, np.ones(10))
    assert result.slope == 0
    assert result(np.array([0.1, 0.9])) == pytest.approx(0.2)


def test_perfect_probabilities_converge():
    ndp = np.arange(10) < 5
    result = fit_recalibration(np.where(ndp, 0.7, 0.3), ndp, np.ones(10))
    assert result.slope > 1
    assert np.isfinite(result(np.array([0.0, 1.0]))).all()


def test_the_identity_and_finite_ends():
    report = np.array([0.0, 1e-5, 0.3, 1.0])
    np.testing.assert_allclose(Recalibration()(report), report, atol=2e-6)


def test_pixels_of_one_kind_are_refused():
    with pytest.raises(InputError, match="no-depth pixels must be some and not all"):
        fit_recalibration(np.full(3, 0.5), np.zeros(3, bool), np.ones(3))


@pytest.mark.parametrize("line", [(np.nan, 0.0), (1.0, np.inf)])
def test_lines_that_are_not_finite_are_refused(line):
    with pytest.raises(InputError, match=r"must be in .*Is the model damaged"):
        Recalibration(*line)
