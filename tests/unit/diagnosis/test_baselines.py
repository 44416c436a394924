"""Simpler ways to name an effect."""

from __future__ import annotations

import numpy as np

from diagnosis.which import baselines
from diagnosis.which.signature import Signature
from tests.unit.diagnosis.made_gaps import FEATURES, MADE, SCENES, VALUES, candidate, likelihood_of


def test_the_largest_drop_is_of_what_explains_most_of_one_feature():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    nothing = Signature(candidate("lens_blur"), VALUES, np.zeros((4, SCENES, FEATURES)))
    arms = [([nothing, MADE["veil"]], likelihood)]
    assert baselines.largest_drop(arms) == "veil"
    assert baselines.largest_drop([([nothing], likelihood)]) == "lens_blur"
    assert baselines.largest_drop([]) is None
