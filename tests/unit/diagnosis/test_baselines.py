"""Simpler ways to name an effect."""

from __future__ import annotations

import numpy as np

from diagnosis.which import rivals
from diagnosis.which.signature import Signature
from tests.unit.diagnosis.test_fit import FEATURES, MADE, SCENES, VALUES, candidate, likelihood_of


def test_the_largest_drop_is_no_feature_s_end():
    """What an effect makes unknown it does not explain."""
    likelihood = likelihood_of({"veil": 0.5}, 7)
    ends = np.where(np.arange(4)[:, None, None] > 0, np.nan, 0.0) * np.ones((SCENES, FEATURES))
    destroying = Signature(candidate("lens_blur"), VALUES, ends)
    arms = [([destroying, MADE["veil"]], likelihood)]
    assert rivals.largest_drop(arms) == "veil"
    assert rivals.largest_drop([([destroying], likelihood)]) == "lens_blur"
    assert rivals.largest_drop([]) is None
