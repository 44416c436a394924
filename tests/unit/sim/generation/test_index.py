"""Rows of the index from files: types and ranges."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest

from starling.patterns.errors import InputError
from starling.sim.datasets import generate, index

ROW: dict[str, Any] = {
    **{
        "frame": 0,
        "view": 0,
        "scene": 0,
        "repeat": 0,
        "name": "0/0",
        "room": "a",
        "sensor": "d435",
    },
    **{"seed": 1, "ndp_rate": 0.1, "mean_dn": 20, "shard": "", "files": ["0/0/a.png"], "bytes": 3},
    "sha256": "0",
}


def test_frames_without_depth_are_reported() -> None:
    rows = [{**ROW, "name": f"0/{number}", "ndp_rate": rate} for number, rate in enumerate((1, 1))]
    message = "2 of 3 frames have no depth, 0/0 first"
    with pytest.warns(UserWarning, match=message):
        generate._warn_of_empty([*rows, {**ROW, "ndp_rate": 0.999}])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        generate._warn_of_empty([{**ROW, "ndp_rate": 0.999}])


def test_a_checked_row_can_be_written(tmp_path: Path) -> None:
    """Exposure and gain are missing, and a whole number stands for a float."""
    row = index.check_row(ROW, tmp_path)
    (tmp_path / index.FILE).write_bytes(index.encode([row]))
    (read,) = index.read(tmp_path)
    assert read == {**ROW, "exposure_s": None, "gain": None}


@pytest.mark.parametrize(
    ("name", "value"), [("repeat", 2**31), ("frame", -1), ("seed", 2**63), ("bytes", -5)]
)
def test_numbers_that_the_index_cannot_hold_are_refused(name: str, value: int) -> None:
    with pytest.raises(InputError, match=name):
        index.check_row({**ROW, name: value}, Path("part.json"))
