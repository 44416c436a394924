"""Effects of the matcher against what matchers of other makes change."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.which import discrepancy, segment
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.discrepancy import Discrepancy, gains_beyond_makes, row_of_make
from starling.diagnosis.which.makes import other_makes
from starling.diagnosis.which.null import LEAST_GAIN
from starling.diagnosis.which.table import Columns
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import D4XX, FAST
from tests.unit.diagnosis.made_gaps import (
    EFFECTS,
    FEATURES,
    FOLDS,
    SCENES,
    SIGNATURES,
    FakeTable,
    likelihood_of,
    noise,
    screening,
)
from tests.unit.diagnosis.test_segment import Captured

MAKES = len(other_makes(D4XX))
RNG = np.random.default_rng(3)
CHANGES = RNG.standard_normal((MAKES, 1, FEATURES)) + 0.05 * RNG.standard_normal(
    (MAKES, SCENES, FEATURES)
)
DISCREPANCY = Discrepancy(changes=CHANGES)
PLAIN = likelihood_of({}, 5)
ANOTHER = CHANGES[:3].mean(axis=0)  # Gap of a make between the known ones.


def gain(gap: np.ndarray, name: str = "crosstalk") -> float:
    gains = DISCREPANCY.gains([EFFECTS[name]], gap, PLAIN, FOLDS, steps=4)
    return gains[name]


def test_a_mixture_of_makes_is_removed():
    rest = DISCREPANCY.remove(ANOTHER)
    assert np.abs(rest).max() < 0.05 * np.abs(ANOTHER).max()


def test_unknown_features_stay_unknown():
    gap = ANOTHER.copy()
    gap[2, 5] = np.nan
    assert np.flatnonzero(np.isnan(DISCREPANCY.remove(gap))).tolist() == [2 * FEATURES + 5]
    changes = CHANGES.copy()
    changes[:, 0, 7] = np.nan
    likelihood = Discrepancy(changes=changes).likelihood(ANOTHER, PLAIN)
    assert np.isnan(likelihood.gap[0, 7]) and np.isfinite(likelihood.gap[1:]).all()


def test_a_setting_gains_nothing_where_the_device_is_another_make():
    assert gain(ANOTHER) < 1


def test_an_effect_that_the_makes_lack_gains():
    change = EFFECTS["crosstalk"].change_at(3).change
    assert gain(ANOTHER + 3 * change) > LEAST_GAIN


def test_an_effect_that_a_make_has_gains_less():
    """The same gap counts less if a make shows the same change."""
    change = EFFECTS["crosstalk"].change_at(3).change
    known = Discrepancy(changes=np.concatenate([CHANGES, change[None]]))
    gains = known.gains([EFFECTS["crosstalk"]], change, PLAIN, FOLDS, steps=4)
    assert gains["crosstalk"] < 0.1 * gain(change)


def test_the_leftover_grows_with_the_gap():
    small, large = (DISCREPANCY.likelihood(scale * ANOTHER, PLAIN) for scale in (0.01, 0.2))
    assert (small.deviation < large.deviation).all()
    assert (small.deviation >= PLAIN.deviation).all()


def test_the_threshold_covers_each_make_as_the_device():
    """One make has an effect that the others lack: its gain is the threshold."""
    change = 3 * EFFECTS["veil"].change_at(3).change
    makes = Discrepancy(changes=np.concatenate([CHANGES, change[None]]))
    gains = makes.without(MAKES).gains(SIGNATURES, change, PLAIN, FOLDS, steps=4)
    threshold = makes.threshold(SIGNATURES, PLAIN, FOLDS)
    assert threshold == pytest.approx(max(gains.values())) and threshold > LEAST_GAIN
    assert DISCREPANCY.threshold(SIGNATURES, PLAIN, FOLDS) >= LEAST_GAIN


@pytest.mark.parametrize("base", [D4XX, dataclasses.replace(FAST, search_px=64)])
def test_makes_keep_the_search_range_and_differ_from_the_base(base: Any):
    makes = other_makes(base)
    assert base not in makes and len(makes) == MAKES - (base.engine == FAST.engine)
    assert {make.search_px for make in makes} == {base.search_px}


def rows_by_make(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the makes change the fake features by `CHANGES`."""
    rows = dict(zip(other_makes(D4XX), CHANGES, strict=True))

    def row(scene: Any, columns: Any, make: Any) -> np.ndarray:
        return rows[make][int(scene.name)]

    monkeypatch.setattr(discrepancy, "row_of_make", row)


def table_of(real: np.ndarray, **options: Any) -> Any:
    sensor = SimpleNamespace(matcher=D4XX)
    scenes = (
        SimpleNamespace(name=str(n), room=str(n), sensor=sensor, against=None)
        for n in range(SCENES)
    )
    table: Any = Captured(real, Segment.DEPTH)
    table.scene_models, table.columns = tuple(scenes), None
    table.pool, table.compared = None, False
    for name, value in options.items():
        setattr(table, name, value)
    return table


class Pool:
    """A pool that works in this process."""

    def __init__(self, table: Any) -> None:
        self.scenes = {scene.name: scene for scene in table.scene_models}

    def submit(self, scene: str, work: Any, *arguments: Any) -> Any:
        return SimpleNamespace(result=lambda: work(self.scenes[scene], *arguments))


@pytest.mark.parametrize("parallel", [False, True])
def test_gains_come_with_their_threshold(monkeypatch: pytest.MonkeyPatch, parallel: bool):
    rows_by_make(monkeypatch)
    table = table_of(ANOTHER)
    table.pool = Pool(table) if parallel else None
    accepted = [EFFECTS["crosstalk"]]
    gains, threshold = gains_beyond_makes(
        table, np.zeros((SCENES, FEATURES)), PLAIN, FOLDS, accepted, SIGNATURES
    )
    assert gains.keys() == {"crosstalk"} and threshold >= LEAST_GAIN > gains["crosstalk"]


@pytest.mark.parametrize(
    "options, expected", [({}, {"crosstalk"}), ({"compared": True}, set())], ids=str
)
def test_another_make_leaves_effects_that_it_would_explain(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], expected: set[str]
):
    """Two captures are compared by the same matcher, so there is no other make."""
    change = FakeTable().change({"crosstalk": 0.4})
    assert change is not None
    monkeypatch.setattr(
        segment, "gains_beyond_makes", lambda *_: ({"crosstalk": 3.0, "veil": 30.0}, 12.0)
    )
    gap = change + noise(7) + 1.5 * (-1.0) ** np.arange(FEATURES)
    result = segment.diagnose_segment(table_of(gap, **options), screening(*SIGNATURES, noise=0.2))
    assert result.unexplained and result.search.accepted
    assert result.like_another_make == expected


def test_an_explained_gap_needs_no_other_make():
    change = FakeTable().change({"crosstalk": 0.4})
    assert change is not None
    result = segment.diagnose_segment(
        table_of(change + noise(7)), screening(*SIGNATURES, noise=0.9)
    )
    assert result.settings and not result.unexplained and not result.like_another_make


def test_features_of_a_make_are_of_the_first_pair(monkeypatch: pytest.MonkeyPatch):
    """Features against the captured depth are unknown."""
    codes = np.random.default_rng(0).integers(0, 255, (3, 48, 96)).astype(np.uint8)
    pairs = StereoObservation(left=codes, right=codes, ours_px=np.zeros((1, 48, 96), np.float32))
    shapes = []

    def features(full: Any, strata: Any, captured_px: Any) -> dict[str, float]:
        shapes.append((full.device_px.shape, captured_px.shape))
        return {"unlike.holes.all": 1.0, "holes.all": 2.0}

    monkeypatch.setattr(discrepancy, "matched_depth_features", features)
    scene: Any = SimpleNamespace(real=pairs, sensor=presets.load("d435"), strata=None)
    names = ("holes.all", "unlike.holes.all")
    row = row_of_make(scene, Columns(segment=Segment.DEPTH, names=names, ceiling=255), FAST)
    assert shapes == [((1, 48, 96), (48, 96))]
    assert row[0] == 2.0 and np.isnan(row[1])
