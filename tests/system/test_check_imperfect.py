"""The validation with an imperfect base, from light to scores, with few scenes and tiny images.

**Rationale.** The captured world has what the base lacks, so a gap stays. The truth records it, the
diagnosis does not see it, and a run keeps its plan.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS, SPOTS
from starling.diagnosis.validation.protocol import case, programs, score_table, seal
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.scene_set import SceneSet
from tests.system import small_check
from tests.system.small_check import TINY

pytestmark = pytest.mark.slow
IMPERFECT = dataclasses.replace(
    TINY,
    number=5,
    sets=1,
    counts={"single": 2, "null": 1},
    left_out=0,
    imperfect=True,
    beyond=0.5,
)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        yield small_check.diagnosed(IMPERFECT, tmp_path_factory.mktemp("check"), patch)


def test_the_truth_records_all_imperfections(done: tuple[Check, list[case.Case]]) -> None:
    check, cases = done
    for each in cases:
        assert IMPERFECTIONS.keys() - each.imperfections.keys() < set(SPOTS)
    sealed = json.loads((check.hidden / seal.TRUTH).read_text())
    assert [entry["imperfections"] for entry in sealed] == [c.imperfections for c in cases]
    assert json.loads((check.folder / seal.REQUEST).read_text())["imperfect"] == "all"


def test_an_imperfect_base_is_scored_by_imperfection(done: tuple[Check, list[case.Case]]) -> None:
    check, cases = done
    scores = check.score(cases)
    assert scores["opened"] == 1 and check.score(cases)["opened"] == 2
    assert scores["cases"] == {"null": 1, "single": 2, "pair": 0, "unknown": 0}
    assert scores["false_alarm"] == 1.0  # The gap is real, and is noticed.
    assert scores["by_imperfection"]["texture"]["singles"] == 2
    assert "imperfection of the base" in score_table.text(json.loads(json.dumps(scores)))


def test_a_run_keeps_its_plan(done: tuple[Check, list[case.Case]]) -> None:
    check, _ = done
    for change in ({"imperfect": "each"}, {"estimated": True}):
        with pytest.raises(WithheldError, match=r"asked\.json must be what"):
            dataclasses.replace(check, **change).prepare()


@pytest.mark.long
def test_estimated_scenes_have_reference_depth_alone(
    done: tuple[Check, list[case.Case]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each case has its own estimates, so the second is not compared with the first."""
    check, cases = done
    seen: list[set[str]] = []
    diagnose = programs.diagnose

    def watched(folder: Path, *arguments: Any, **options: Any) -> None:
        seen.append({path.name for path in folder.rglob("*") if path.is_file()})
        diagnose(folder, *arguments, **options)

    monkeypatch.setattr(programs, "diagnose", watched)
    scene_set = SceneSet(
        folder=tmp_path / "set", number=0, source=check.sets[0].source, estimated=True
    )
    scene_set.diagnose(cases[:2], [])
    assert {"truth.png", "depth.png", "ir_left.png"} <= seen[0] and "scene.toml" not in seen[0]
    assert len(scene_set.results(cases[:2])) == 2
