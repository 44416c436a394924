"""Detection limits: departures from the neutral, read from what the diagnosis told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import limits


def test_each_side_has_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects unknown here have none; what is never found is infinitely far."""
    told = {
        "gamma": {"base": 1, "below": 0.9, "above": 1.3},
        "veil": {"base": 0, "below": None, "above": None},
        "sunlight": {"base": 0, "below": None, "above": 2},
        # Its page begins at 0.02.
        "pixel_locking": {"base": 0, "below": -0.0005, "above": 0.0005},
    }
    _told(told, tmp_path, monkeypatch)
    found = limits.read()
    assert found.departures == {
        ("gamma", 1): pytest.approx(0.3),
        ("gamma", -1): pytest.approx(1 / 9),
        ("veil", 1): float("inf"),
        ("pixel_locking", 1): 0.02,
        ("pixel_locking", -1): 0.02,
    }
    assert found.choices == {}


def test_choices_are_those_that_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Words have other numbers on an effect's page: any one stands for all."""
    told = {
        "quantisation": {"found": [8, 12, 200]},
        "hole_filling": {"found": ["left"]},
        "median": {"found": []},
    }
    _told(told, tmp_path, monkeypatch)
    found = limits.read()
    assert found.departures == {}
    assert found.choices == {"quantisation": (8, 12), "hole_filling": (1, 2, 3), "median": ()}


def test_a_limit_is_a_departure_from_the_camera_that_it_was_made_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of another camera with more blur of its own it is the same departure."""
    _told({"lens_blur": {"base": 0.6, "below": 0.5, "above": 0.72}}, tmp_path, monkeypatch)
    assert limits.read().departures == {
        ("lens_blur", 1): pytest.approx(0.12),
        ("lens_blur", -1): pytest.approx(0.1),
    }


def test_the_shipped_file_knows_the_table() -> None:
    found = limits.read(of=ROWS)
    assert {*(name for name, _ in found.departures), *found.choices} == {
        row.name for row in ROWS.values() if row.kind != "outside"
    }
    assert all(departure > 0 for departure in found.departures.values())


def test_limits_of_some_effects_are_not_taken_for_those_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is outside the table has none; of all else the page's low end is no limit."""
    _told({"veil": {"base": 0, "below": None, "above": 0.1}}, tmp_path, monkeypatch)
    assert limits.read(of=("veil", "lens_ghost")).departures == {("veil", 1): 0.1}
    words = r"detection limits must hold .*; got .* without \['gamma', 'median'\]\. Make the file"
    with pytest.raises(WithheldError, match=words):
        limits.read(of=("veil", "median", "gamma", "lens_ghost"))


@pytest.mark.parametrize(
    "told, words",
    [
        ([1], "detection limits must be a table; got list"),
        ({"veil": {"base": 0, "below": "a", "above": None}}, "limit of veil must be numbers"),
        ({"veil": {"below": 0.1}}, "limit of veil must have a base and two sides"),
        ({"median": [0, 5]}, "limit of median must be a list of choices"),
        ({"median": {"found": 5}}, "limit of median must be a list of choices"),
    ],
)
def test_damaged_limits(
    told: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _told(told, tmp_path, monkeypatch)
    with pytest.raises(WithheldError, match=words):
        limits.read()


def test_missing_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "FILE", tmp_path / "none.json")
    with pytest.raises(WithheldError, match=r"detection limits must be .* adapters\.detection"):
        limits.read()


def _told(told: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "limits.json"
    path.write_text(json.dumps(told), encoding="utf-8")
    monkeypatch.setattr(limits, "FILE", path)
