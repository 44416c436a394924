"""What of the table is tried where an effect is left out, and what is told of the table."""

from __future__ import annotations

import json
from pathlib import Path

from diagnosis import batch, families
from sim import effects

ALL = {row.family for row in effects.table()}


def test_nothing_is_left_out_unasked():
    assert batch._families(None, twins=True) is None


def test_a_family_goes_and_with_twins_all_that_look_alike():
    alone = batch._families("nir_reflectance", twins=False)
    assert alone is not None and ALL - set(alone) == {"reflectance"}
    both = batch._families("nir_reflectance", twins=True)
    # Its own page names the last two and projector power, whose page names it.
    twins = {"signal_gain", "ambient_gradient", "transparency"}
    assert both is not None and ALL - set(both) == {"reflectance", *twins}


def test_families_are_written_whole(tmp_path: Path):
    assert families.main([str(tmp_path / "told.json")]) == 0
    told = json.loads((tmp_path / "told.json").read_text())
    assert {one["family"] for one in told.values()} == ALL and set(told) == {
        row.name for row in effects.table()
    }
    assert "nir_reflectance" in told["projector_power"]["twins"]
    assert all(name in told[twin]["twins"] for name in told for twin in told[name]["twins"])
