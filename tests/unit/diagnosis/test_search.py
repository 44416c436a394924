"""What a search names at last: what is borne out, and of equals the more plausible."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.which import search
from diagnosis.which.model import Model
from diagnosis.which.signature import Signature
from tests.unit.diagnosis.test_fit import (
    FEATURES,
    MADE,
    VALUES,
    FakeBench,
    candidate,
    likelihood_of,
    searched,
    trial,
)


@pytest.mark.parametrize("share, first", [(1.0, "exposure"), (0.9, "nir_reflectance")])
def test_of_equals_the_sensor_s_own_comes_before_the_scene_s(share, first):
    """That all surfaces are other than told is less plausible; but only where the data are even."""
    whole = MADE["lens_blur"].change
    bent = np.where(np.arange(FEATURES) % 2, whole, share * whole)
    made = {
        "nir_reflectance": Signature(candidate("nir_reflectance"), VALUES, whole),
        "exposure": Signature(candidate("exposure"), VALUES, 0.5 * bent),
    }
    bench = FakeBench(made)
    (accepted,) = searched({"nir_reflectance": 0.3}, bench=bench, names=tuple(made)).accepted
    assert accepted.fit.name == first
    names = {accepted.fit.name, *(one.name for one in accepted.rivals)}
    assert names == set(made)


def test_what_does_not_gain_enough_beside_the_others_is_left_out():
    for truth, left in (({"crosstalk": 0.4}, ["crosstalk"]), ({}, [])):
        likelihood = likelihood_of(truth, 7)
        terms = (MADE["crosstalk"], MADE["veil"])
        both = Model(terms, (1.67, 0.1), likelihood.nothing)
        found = search._borne_out(both, trial(FakeBench(), likelihood))
        assert list(found.settings) == left
