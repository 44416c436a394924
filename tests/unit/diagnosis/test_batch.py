"""What of the table is tried where an effect is left out, and what is told of the table."""

from __future__ import annotations

import json
from pathlib import Path

from starling.diagnosis.validation.adapters import batch, families
from starling.sim import effects

ALL = frozenset(row.family for row in effects.table())


def test_nothing_is_left_out_unasked(tmp_path: Path):
    assert batch._missing(tmp_path, "7", None) == {tmp_path / "7.json": ALL}


def test_a_family_goes_and_with_twins_all_that_look_alike(tmp_path: Path):
    told = batch._missing(tmp_path, "7", {"7": "nir_reflectance"})
    alone, both = (
        told[tmp_path / table / "7.json"] for table in ("without family", "without twins")
    )
    assert ALL - alone == {"reflectance"}
    # Its own page names the last two and projector power, whose page names it.
    twins = {"signal_gain", "ambient_gradient", "transparency"}
    assert ALL - both == {"reflectance", *twins}


def test_verdicts_that_are_there_are_not_missing(tmp_path: Path):
    (tmp_path / "7.json").touch()
    assert batch._missing(tmp_path, "7", None) == {}
    assert len(batch._missing(tmp_path, "7", {"7": "roll"})) == 2


def test_families_are_written_whole(tmp_path: Path):
    assert families.main([str(tmp_path / "told.json")]) == 0
    told = json.loads((tmp_path / "told.json").read_text())
    assert {one["family"] for one in told.values()} == ALL and set(told) == {
        row.name for row in effects.table()
    }
    assert "nir_reflectance" in told["projector_power"]["twins"]
    assert all(name in told[twin]["twins"] for name in told for twin in told[name]["twins"])
