"""Detection limits: departures from the neutral, read from what the diagnosis told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from diagnosis.withheld import limits
from diagnosis.withheld.catalogue import ROWS
from diagnosis.withheld.errors import WithheldError
from diagnosis.withheld.nominal import Nominal


def test_a_limit_is_to_the_side_that_is_found_later(
    camera: Nominal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Effects unknown here have none; what is never found is infinitely far."""
    told = {
        "gamma": [0.9, 1.3],
        "veil": [None, None],
        "sunlight": [None, 2],
        "edge_jump": [4, None],
        "pixel_locking": [-0.0005, 0.0005],  # Its page begins at 0.02.
    }
    _told(told, tmp_path, monkeypatch)
    found = limits.read(camera)
    assert found.departures == {
        "gamma": pytest.approx(0.3),
        "veil": float("inf"),
        "edge_jump": 0.25,
        "pixel_locking": 0.02,
    }
    assert found.choices == {}


def test_choices_are_those_that_are_found(
    camera: Nominal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Words have other numbers on an effect's page: any one stands for all."""
    told = {
        "search_range": {"found": [16, 48, 200]},
        "hole_filling": {"found": ["left"]},
        "median": {"found": []},
    }
    _told(told, tmp_path, monkeypatch)
    found = limits.read(camera)
    assert found.departures == {}
    assert found.choices == {"search_range": (16, 48), "hole_filling": (1, 2, 3), "median": ()}


def test_the_shipped_file_knows_the_table(camera: Nominal) -> None:
    found = limits.read(camera)
    assert {"gamma", "lens_blur", "read_noise"} <= found.departures.keys() <= ROWS.keys()
    assert all(departure > 0 for departure in found.departures.values())


@pytest.mark.parametrize(
    "told, words",
    [
        ([1], "detection limits must be a table; got list"),
        ({"veil": ["a", None]}, "limit of veil must be numbers"),
        ({"veil": [0.1]}, "limit of veil must have two sides"),
        ({"median": [0, 5]}, "limit of median must be a list of choices"),
        ({"median": {"found": 5}}, "limit of median must be a list of choices"),
    ],
)
def test_damaged_limits(
    told: Any, words: str, camera: Nominal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _told(told, tmp_path, monkeypatch)
    with pytest.raises(WithheldError, match=words):
        limits.read(camera)


def test_missing_limits(camera: Nominal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "FILE", tmp_path / "none.json")
    with pytest.raises(WithheldError, match=r"detection limits must be .* diagnosis\.detection"):
        limits.read(camera)


def _told(told: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "limits.json"
    path.write_text(json.dumps(told), encoding="utf-8")
    monkeypatch.setattr(limits, "FILE", path)
