"""Likelihood of single features, near and far from the prediction."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.which.likelihood import FREEDOM, LARGEST, TAU, Likelihood
from starling.diagnosis.which.response import PredictedChange

_SHAPE = (1, 5)
_FAR = float(np.sqrt(LARGEST))


def _gain(gap: float, change: float) -> float:
    """Compute the gain of one feature; gap and change are in standard deviations."""
    likelihood = Likelihood(np.full(_SHAPE, gap), np.ones(_SHAPE), np.eye(_SHAPE[1])[0])
    predicted = PredictedChange(np.full(_SHAPE, change))
    return float((likelihood.cost(likelihood.no_change) - likelihood.cost(predicted)).sum())


@given(st.floats(0, 1e3), st.floats(-3, 0))
def test_a_change_in_the_wrong_direction_never_gains(gap: float, share: float):
    """Otherwise the model error of a wrong change of 10 would gain on a feature that is 90 off."""
    assert _gain(gap, share * gap) <= 1e-9


@given(st.floats(3 * _FAR, 1e3), st.floats(0, 0.3))
def test_a_feature_that_stays_far_off_gains_by_the_distance_alone(gap: float, share: float):
    rest, model_error = gap - share * gap, np.hypot(1.0, TAU * share * gap)
    assert rest / model_error > _FAR  # Far off even with the effect's model error.
    by_distance = (FREEDOM + 1) * np.log(gap / rest)
    assert _gain(gap, share * gap) <= by_distance + 1e-9


def test_an_explained_feature_gains_at_any_distance():
    assert _gain(90.0, 90.0) > _gain(30.0, 30.0) > _gain(30.0, 20.0) > 3
