"""Simpler ways to name an effect."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np

from starling.diagnosis.validation.adapters import batch
from starling.diagnosis.which import baselines
from starling.diagnosis.which.response import Signature
from tests.unit.diagnosis.made_gaps import FEATURES, MADE, SCENES, VALUES, candidate, likelihood_of


def test_the_largest_drop_is_of_what_explains_most_of_one_feature():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    nothing = Signature(candidate("lens_blur"), VALUES, np.zeros((4, SCENES, FEATURES)))
    arms = [([nothing, MADE["veil"]], likelihood)]
    assert baselines.largest_drop(arms) == "veil"
    assert baselines.largest_drop([([nothing], likelihood)]) == "lens_blur"
    assert baselines.largest_drop([]) is None


def test_the_nearest_points_as_the_gap_does_and_the_largest_drop_takes_most_off_one_feature():
    truth = MADE["veil"]
    likelihood = likelihood_of({"veil": 0.5}, 7)
    most = int(np.argmax(np.abs(likelihood.gap).mean(axis=0)))
    single = np.zeros((SCENES, FEATURES))
    single[:, most] = likelihood.gap[:, most]
    made = {
        "veil": truth,
        "gain": Signature(candidate("gain"), VALUES, -truth.change),
        "crosstalk": MADE["crosstalk"],
        "dsnu": Signature(candidate("dsnu"), VALUES, np.stack([v * single for v in VALUES])),
    }
    arms = [(list(made.values()), likelihood)]
    assert baselines.nearest(arms) == "veil"
    assert baselines.largest_drop(arms) == "dsnu"
    backwards = dataclasses.replace(likelihood, gap=-likelihood.gap)
    assert baselines.nearest([(list(made.values()), backwards)]) == "gain"
    both_ways = np.stack([-truth.change[-1], 0 * truth.change[0], truth.change[-1]])
    signed = Signature(candidate("gamma"), (-1.0, 0.0, 1.0), both_ways)
    for gap in (likelihood, backwards):
        assert baselines.nearest([([signed, MADE["crosstalk"]], gap)]) == "gamma"
    assert baselines.nearest([]) is None and baselines.by_lot([], seed=0) is None
    lots = [baselines.by_lot(arms, seed=seed) for seed in range(60)]
    assert set(lots) == set(made) and lots[0] == baselines.by_lot(arms, seed=0)


def test_both_arms_are_asked_at_once():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    weak = dataclasses.replace(likelihood, gap=0.1 * likelihood.gap)
    arms = [([MADE["crosstalk"]], weak), ([MADE["veil"]], likelihood)]
    assert baselines.nearest(arms) == baselines.largest_drop(arms) == "veil"
    screens: Any = [
        SimpleNamespace(screen=SimpleNamespace(rough=rough), likelihood=of) for rough, of in arms
    ]
    lot = baselines.by_lot(arms, seed=5)
    told = {"largest_drop": "veil", "cosine": "veil", "random": lot}
    assert batch._baselines(screens, seed=5) == told
