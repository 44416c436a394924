"""Models that come with the program: they can be read, and say what they have learnt from."""

from __future__ import annotations

from pathlib import Path

import pytest

from learning import shipped
from learning.train_captures import trained
from sim.output import RECORD

FOLDER = Path(shipped.__file__).parent


@pytest.mark.parametrize("name", shipped.NAMES)
def test_a_shipped_model_is_read_by_its_name(name):
    method, predictor = trained(Path(name))
    assert name == f"{method}-varied"
    assert predictor.shape == (360, 640)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", shipped.NAMES)
def test_its_record_names_no_place_and_its_card_names_it(name):
    folder = FOLDER / name
    assert {path.name for path in folder.iterdir()} == {RECORD, f"{name.split('-')[0]}.pt"}
    assert "/" not in (folder / RECORD).read_text()
    assert f"`{name}`" in (FOLDER / "README.md").read_text()


def test_other_paths_stand_for_themselves(tmp_path):
    assert shipped.folder(tmp_path) == tmp_path
    assert shipped.folder(Path("hybrid-varied")) == FOLDER / "hybrid-varied"
