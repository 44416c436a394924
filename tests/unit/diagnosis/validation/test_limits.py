"""Detection limits: departures from the neutral, read from the file of the diagnosis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import limits


def test_each_side_has_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unknown effects have no limit. Effects that are never detected have an infinite limit."""
    table = {
        "gamma": {"base": 1, "below": 0.9, "above": 1.3},
        "veil": {"base": 0, "below": None, "above": None},
        "sunlight": {"base": 0, "below": None, "above": 2},
        # The range of its page starts at 0.02.
        "pixel_locking": {"base": 0, "below": -0.0005, "above": 0.0005},
    }
    _write_limits(table, tmp_path, monkeypatch)
    detection_limits = limits.read()
    assert detection_limits.departures == {
        ("gamma", 1): pytest.approx(0.3),
        ("gamma", -1): pytest.approx(1 / 9),
        ("veil", 1): float("inf"),
        ("pixel_locking", 1): 0.02,
        ("pixel_locking", -1): 0.02,
    }
    assert detection_limits.choices == {}


def test_only_detectable_choices_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the file has words in place of numbers, any word makes all choices detectable."""
    table = {
        "quantisation": {"found": [8, 12, 200]},
        "hole_filling": {"found": ["left"]},
        "median": {"found": []},
    }
    _write_limits(table, tmp_path, monkeypatch)
    detection_limits = limits.read()
    assert detection_limits.departures == {}
    assert detection_limits.choices == {
        "quantisation": (8, 12),
        "hole_filling": (1, 2, 3),
        "median": (),
    }


def test_a_limit_is_a_departure_from_the_base_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A camera with more blur has the same departure."""
    _write_limits({"lens_blur": {"base": 0.6, "below": 0.5, "above": 0.72}}, tmp_path, monkeypatch)
    assert limits.read().departures == {
        ("lens_blur", 1): pytest.approx(0.12),
        ("lens_blur", -1): pytest.approx(0.1),
    }


def test_the_shipped_file_holds_the_table() -> None:
    detection_limits = limits.read(required=ROWS)
    assert {*(name for name, _ in detection_limits.departures), *detection_limits.choices} == {
        row.name for row in ROWS.values() if row.kind != "outside"
    }
    assert all(departure > 0 for departure in detection_limits.departures.values())


def test_limits_of_two_bases_hold_on_both() -> None:
    first = limits.DetectionLimits(
        departures={("veil", 1): 0.1, ("gamma", 1): 0.3, ("gamma", -1): 0.2},
        choices={"median": (3, 5), "quantisation": (8,)},
    )
    second = limits.DetectionLimits(
        departures={("veil", 1): float("inf"), ("gamma", 1): 0.1, ("yaw", 1): 0.5},
        choices={"median": (5,)},
    )
    assert first.and_limits(second) == limits.DetectionLimits(
        departures={("veil", 1): float("inf"), ("gamma", 1): 0.3, ("gamma", -1): 0.2},
        choices={"median": (5,), "quantisation": (8,)},
    )


def test_limits_of_an_imperfect_base_are_of_effects_on_the_images() -> None:
    imperfect, perfect = limits.read(limits.IMPERFECT_FILE), limits.read()
    assert {("veil", 1), ("exposure", -1)} <= imperfect.departures.keys()
    kinds = {ROWS[name].kind for name, _ in imperfect.departures}
    assert kinds == {"image"}
    raised = [key for key, least in imperfect.departures.items() if least > perfect.departures[key]]
    assert len(raised) > len(imperfect.departures) / 2


def test_missing_effects_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects outside the table need no limit. All other effects do."""
    _write_limits({"veil": {"base": 0, "below": None, "above": 0.1}}, tmp_path, monkeypatch)
    assert limits.read(required=("veil", "lens_ghost")).departures == {("veil", 1): 0.1}
    words = r"detection limits must hold .*; got .* without \['gamma', 'median'\]\. Write it again"
    with pytest.raises(WithheldError, match=words):
        limits.read(required=("veil", "median", "gamma", "lens_ghost"))


@pytest.mark.parametrize(
    "table, words",
    [
        ([1], "detection limits must be a table; got list"),
        ({"veil": {"base": 0, "below": "a", "above": None}}, "limit of veil must be numbers"),
        ({"veil": {"base": 0, "below": float("nan"), "above": None}}, "must be numbers"),
        ({"gamma": {"base": 0, "below": 1, "above": 2}}, "must be numbers above zero"),
        ({"veil": {"below": 0.1}}, "limit of veil must have a base and two sides"),
        ({"median": [0, 5]}, "limit of median must be a list of choices"),
        ({"median": {"found": 5}}, "limit of median must be a list of choices"),
    ],
)
def test_damaged_limits(
    table: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write_limits(table, tmp_path, monkeypatch)
    with pytest.raises(WithheldError, match=words):
        limits.read()


def test_missing_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "FILE", tmp_path / "none.json")
    with pytest.raises(WithheldError, match=r"detection limits must be .*adapters detection"):
        limits.read()


def _write_limits(table: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "limits.json"
    path.write_text(json.dumps(table), encoding="utf-8")
    monkeypatch.setattr(limits, "FILE", path)
