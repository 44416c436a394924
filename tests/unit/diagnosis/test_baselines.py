"""Simpler ways to name an effect."""

from __future__ import annotations

import numpy as np

from diagnosis.which import rivals
from diagnosis.which.signature import Signature
from tests.unit.diagnosis.made_gaps import FEATURES, MADE, SCENES, VALUES, candidate, likelihood_of


def test_the_largest_drop_is_of_what_explains_most_of_one_feature():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    nothing = Signature(candidate("lens_blur"), VALUES, np.zeros((4, SCENES, FEATURES)))
    arms = [([nothing, MADE["veil"]], likelihood)]
    assert rivals.largest_drop(arms) == "veil"
    assert rivals.largest_drop([([nothing], likelihood)]) == "lens_blur"
    assert rivals.largest_drop([]) is None
