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
    """Choices and effects unknown here have none; what is never found is infinitely far."""
    told = {"gamma": [0.9, 1.3], "veil": [None, None], "sunlight": [None, 2], "median": [0, 5]}
    _told(told, tmp_path, monkeypatch)
    assert limits.read(camera) == {"gamma": pytest.approx(0.3), "veil": float("inf")}


def test_the_shipped_file_knows_the_table(camera: Nominal) -> None:
    found = limits.read(camera)
    assert {"gamma", "lens_blur", "read_noise"} <= found.keys() <= ROWS.keys()
    assert all(departure > 0 for departure in found.values())


@pytest.mark.parametrize(
    "told, words",
    [
        ([1], "detection limits must be a table; got list"),
        ({"veil": ["a", None]}, "limit of veil must be numbers"),
        ({"veil": [0.1]}, "limit of veil must have two sides"),
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
