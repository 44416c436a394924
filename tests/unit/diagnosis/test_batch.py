"""Families that are tried when an effect is left out, and the families file."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.adapters import batch
from starling.patterns.errors import InputError
from starling.sim import effects

ALL = frozenset(row.family for row in effects.table())


def test_all_families_are_tried_by_default(tmp_path: Path):
    assert batch._missing(tmp_path, "7", None) == {tmp_path / "7.json": ALL}


def test_family_and_confusable_families_are_left_out(tmp_path: Path):
    content = batch._missing(tmp_path, "7", {"7": "nir_reflectance"})
    alone, both = (
        content[tmp_path / table / "7.json"] for table in ("without family", "without twins")
    )
    assert ALL - alone == {"reflectance"}
    # Its page names projector power, the gradient and transparency; two others name it.
    twins = {"signal_gain", "ambient_gradient", "ambient_occlusion", "texture", "transparency"}
    assert ALL - both == {"reflectance", *twins}


def test_existing_verdicts_are_not_missing(tmp_path: Path):
    (tmp_path / "7.json").touch()
    assert batch._missing(tmp_path, "7", None) == {}
    assert len(batch._missing(tmp_path, "7", {"7": "roll"})) == 2


def test_all_families_are_written(tmp_path: Path):
    assert adapters.main(["families", str(tmp_path / "told.json")]) == 0
    content = json.loads((tmp_path / "told.json").read_text())
    assert {entry["family"] for entry in content.values()} == ALL and set(content) == {
        row.name for row in effects.table()
    }
    assert "nir_reflectance" in content["projector_power"]["twins"]
    assert all(
        name in content[twin]["twins"] for name in content for twin in content[name]["twins"]
    )


@pytest.mark.parametrize("content", ["[", "[]", '{"7": 3}', "[" * 9999])
def test_damaged_lists_of_left_out_effects_are_refused(tmp_path: Path, content: str):
    (tmp_path / "without.json").write_text(content)
    with pytest.raises(InputError, match=r"must be (a )?JSON"):
        batch._left_out(tmp_path / "without.json")


def scene_models(case: str, *, previous: list[Any], scene: str = "hall") -> Any:
    pairs: Any = [(SimpleNamespace(name=scene), None)]
    sensor: Any = None
    return batch._scene_models(case, pairs, sensor, previous, {})


def test_capture_sets_must_show_the_same_scenes():
    attic = SimpleNamespace(name="attic", frames=1)
    with pytest.raises(InputError, match=r"scenes must be the same in all .*hall"):
        scene_models("7", previous=[attic])


def test_capture_sets_must_have_equally_many_repeats(monkeypatch: pytest.MonkeyPatch):
    two = SimpleNamespace(name="hall", frames=2)
    monkeypatch.setattr(batch, "with_capture", lambda model, scene, against: two)
    with pytest.raises(InputError, match=r"repeats must be equally many .*'7', \[2\].* Give \[1\]"):
        scene_models("7", previous=[SimpleNamespace(name="hall", frames=1)])
    assert scene_models("7", previous=[two]) == [two]
