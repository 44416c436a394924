"""How likely a gap is with what effects make of it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.which.likelihood import FREEDOM, LARGEST, TAU, Likelihood
from starling.diagnosis.which.predicted import Made

_ROWS = (1, 5)
_BEYOND = float(np.sqrt(LARGEST))


def _gain(gap: float, change: float) -> float:
    """Of one feature, gap and change in deviations."""
    likelihood = Likelihood(np.full(_ROWS, gap), np.ones(_ROWS), np.eye(_ROWS[1])[0])
    made = Made(np.full(_ROWS, change))
    return float((likelihood.cost(likelihood.nothing) - likelihood.cost(made)).sum())


@given(st.floats(0, 1e3), st.floats(-3, 0))
def test_what_goes_the_wrong_way_never_gains_by_being_less_sure(gap: float, share: float):
    """An effect that makes a feature 10 wrong by 2 of its own would gain on one that is 90 off."""
    assert _gain(gap, share * gap) <= 1e-9


@given(st.floats(3 * _BEYOND, 1e3), st.floats(0, 0.3))
def test_what_stays_far_off_gains_by_how_far_it_is_brought_alone(gap: float, share: float):
    left, unsure = gap - share * gap, np.hypot(1.0, TAU * share * gap)
    assert left / unsure > _BEYOND  # Far off also by what the effect may be wrong by itself.
    brought = (FREEDOM + 1) * np.log(gap / left)
    assert _gain(gap, share * gap) <= brought + 1e-9


def test_what_explains_a_feature_gains_by_it_however_far_off_it_is():
    assert _gain(90.0, 90.0) > _gain(30.0, 30.0) > _gain(30.0, 20.0) > 3
