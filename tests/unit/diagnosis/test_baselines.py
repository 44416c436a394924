"""Baseline methods of attribution."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np

from starling.diagnosis.validation.adapters import batch
from starling.diagnosis.which import baselines
from starling.diagnosis.which.response import Signature
from tests.unit.diagnosis.made_gaps import (
    EFFECTS,
    FEATURES,
    SCENES,
    VALUES,
    candidate,
    likelihood_of,
)


def test_largest_drop_names_the_effect_that_most_reduces_one_feature():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    idle = Signature(candidate("lens_blur"), VALUES, np.zeros((4, SCENES, FEATURES)))
    segments = [([idle, EFFECTS["veil"]], likelihood)]
    assert baselines.largest_drop(segments) == "veil"
    assert baselines.largest_drop([([idle], likelihood)]) == "lens_blur"
    assert baselines.largest_drop([]) is None


def test_nearest_direction_and_largest_drop_can_differ():
    """`dsnu` removes the largest feature completely; `veil` has the direction of the gap."""
    truth = EFFECTS["veil"]
    likelihood = likelihood_of({"veil": 0.5}, 7)
    most = int(np.argmax(np.abs(likelihood.gap).mean(axis=0)))
    single = np.zeros((SCENES, FEATURES))
    single[:, most] = likelihood.gap[:, most]
    signatures = {
        "veil": truth,
        "gain": Signature(candidate("gain"), VALUES, -truth.change),
        "crosstalk": EFFECTS["crosstalk"],
        "dsnu": Signature(candidate("dsnu"), VALUES, np.stack([v * single for v in VALUES])),
    }
    segments = [(list(signatures.values()), likelihood)]
    assert baselines.nearest_direction(segments) == "veil"
    assert baselines.largest_drop(segments) == "dsnu"
    reverse = dataclasses.replace(likelihood, gap=-likelihood.gap)
    assert baselines.nearest_direction([(list(signatures.values()), reverse)]) == "gain"
    both_ways = np.stack([-truth.change[-1], 0 * truth.change[0], truth.change[-1]])
    signed = Signature(candidate("gamma"), (-1.0, 0.0, 1.0), both_ways)
    for gap in (likelihood, reverse):
        assert baselines.nearest_direction([([signed, EFFECTS["crosstalk"]], gap)]) == "gamma"
    assert baselines.nearest_direction([]) is None and baselines.random_choice([], seed=0) is None
    names = [baselines.random_choice(segments, seed=seed) for seed in range(60)]
    assert set(names) == set(signatures)
    assert names[0] == baselines.random_choice(segments, seed=0)


def test_baselines_choose_among_all_segments():
    likelihood = likelihood_of({"veil": 0.5}, 7)
    weak = dataclasses.replace(likelihood, gap=0.1 * likelihood.gap)
    segments = [([EFFECTS["crosstalk"]], weak), ([EFFECTS["veil"]], likelihood)]
    assert baselines.nearest_direction(segments) == baselines.largest_drop(segments) == "veil"
    results: Any = [
        SimpleNamespace(screening=SimpleNamespace(signatures=signatures), likelihood=gap)
        for signatures, gap in segments
    ]
    name = baselines.random_choice(segments, seed=5)
    expected = {"largest_drop": "veil", "cosine": "veil", "random": name}
    assert batch._baselines(results, seed=5) == expected
