"""Verdicts: valid files are read and damaged files are refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import verdict
from tests.unit.diagnosis.validation.made_results import make_effect, make_verdict


def test_a_verdict_is_read(tmp_path: Path) -> None:
    weak = make_effect("second_projector.x", "left", gain=3.0, segment="depth")
    strong = make_effect("lens_blur", 0.8, "dot_blur", "corner_blur", "dot_blur", gain=30)
    path = tmp_path / "verdict.json"
    path.write_text(
        json.dumps(make_verdict("effects", weak, strong, cosine="dot_blur", random=None))
    )
    read = verdict.read(path)
    assert read.kind == "effects" and read.answer == "lens_blur"
    assert [effect.name for effect in read.named] == ["lens_blur", "second_projector.x"]
    first, second = read.named
    assert (first.value, first.interval) == (0.8, (0.7000000000000001, 0.9))
    assert first.rows == {"lens_blur", "dot_blur", "corner_blur"}
    assert (second.row, second.value, second.segment) == ("second_projector", "left", "depth")
    assert read.baselines == {"cosine": "dot_blur", "random": None}
    assert read.seconds == 2.0


def test_a_credible_set_holds_effects_without_parameters() -> None:
    equivalent = make_effect("second_projector.x", "left", "second_projector.power", "veil")
    read = verdict.from_table({**make_verdict("effects", equivalent), "seconds": 0})
    assert read.named[0].rows == {"second_projector", "veil"}
    assert read.seconds == 0.0


def test_surrogate_effects_are_not_named() -> None:
    read = verdict.from_table(
        make_verdict("none of the known", make_effect("lens_blur", surrogate=True))
    )
    assert read.effects and not read.named and read.top_effect is None
    assert read.answer == "none of the known"
    both = make_verdict("effects", make_effect("veil", surrogate=True), make_effect("roll", gain=3))
    assert [effect.name for effect in verdict.from_table(both).named] == ["roll"]


@pytest.mark.parametrize(("beyond", "leaves"), [(0.99, False), (1.01, True)])
def test_a_verdict_with_a_named_effect_may_leave_a_gap(beyond: float, leaves: bool) -> None:
    table = make_verdict("effects", make_effect("roll"))
    table["left"]["depth"] = {"beyond": beyond, "below": 1.0}
    read = verdict.from_table(table)
    assert read.answer == "roll" and read.leaves_gap is leaves


def test_only_a_verdict_of_an_unknown_effect_leaves_a_gap_by_its_kind() -> None:
    kinds = ("none of the known", "no gap", "cannot tell")
    leaving = [verdict.from_table(make_verdict(kind)).leaves_gap for kind in kinds]
    assert leaving == [True, False, False]


def test_headline_is_that_of_the_segment_of_the_top_effect() -> None:
    table = make_verdict("effects", make_effect("median", 3, segment="depth"), closed=20.0)
    assert verdict.from_table(table).headline_pct is None
    table["howfar"]["features of the depth"] = {"closed_pct": None}
    assert verdict.from_table(table).headline_pct is None
    table["howfar"]["features of the depth"] = {"closed_pct": 70.0}
    assert verdict.from_table(table).headline_pct == 70.0
    assert verdict.from_table(make_verdict("no gap", metric="ndp_brier")).headline_pct is None


def test_a_segment_without_a_named_effect_has_no_headline() -> None:
    """The gap reduction of the depth segment does not count for the image segment."""
    table = make_verdict("effects", make_effect("median", 3, segment="depth"), closed=20.0)
    table["left"]["image"] = table["left"]["depth"]
    table["howfar"]["features of the depth"] = {"closed_pct": 88.0}
    read = verdict.from_table(table)
    assert read.headline_pct == 88.0 and read.restricted_to("image").headline_pct is None


def test_a_verdict_is_restricted_to_one_segment() -> None:
    """A gap in the depth segment does not affect the image segment, and vice versa."""
    median = make_effect("median", 3, segment="depth", surrogate=True)
    table = make_verdict("effects", median, make_effect("veil", gain=3.0))
    table["baselines_by_arm"]["depth"] = {"cosine": "veil"}
    read = verdict.from_table(table)
    image, depth = read.restricted_to("image"), read.restricted_to("depth")
    assert image.kind == "effects" and [effect.name for effect in image.named] == ["veil"]
    assert depth.kind == "none of the known" and not depth.named
    assert [effect.name for effect in depth.effects] == ["median"]
    assert depth.baselines == {"cosine": "veil"}
    with pytest.raises(WithheldError, match=r"arm must be one of \['depth', 'image'\]; got whole"):
        read.restricted_to("whole")


@pytest.mark.parametrize(("beyond", "kind"), [(1.0, "no gap"), (1.01, "none of the known")])
def test_a_segment_without_effects_may_be_unexplained(beyond: float, kind: str) -> None:
    """A residual equal to the limit is explained."""
    table = make_verdict("effects", make_effect("median", 3, segment="depth"))
    table["left"]["image"]["beyond"] = beyond
    assert verdict.from_table(table).restricted_to("image").kind == kind


DAMAGE: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no verdict": (lambda s: s.pop("verdict"), "verdict must have the key verdict; got ['base"),
    "kind": (lambda s: s.update(verdict="fine"), "verdict.verdict must be one of ('effects', "),
    "surrogate": (
        lambda s: s["effects"][0].update(stand_in=1),
        "[0].stand_in must be true or false; got 1.",
    ),
    "no list": (lambda s: s.update(effects={}), "verdict.effects must be a list; got {}. Run"),
    "none": (lambda s: s.update(effects=[]), "effects must name one in this verdict; got none."),
    "no object": (lambda s: s.update(effects=[3]), "effects[0] must be an object; got 3."),
    "name": (lambda s: s["effects"][0].update(name=""), "[0].name must be a name; got ''."),
    "arm": (lambda s: s["effects"][0].update(arm="leg"), "[0].arm must be one of ('image', "),
    "value": (lambda s: s["effects"][0].update(parameters={}), "must have the key lens_blur; got"),
    "set": (lambda s: s["effects"][0].update(set=["veil"]), "[0].set must hold lens_blur itself"),
    "gain": (
        lambda s: s["effects"][0].update(gain=math.nan),
        "gain must be a finite number; got n",
    ),
    "true": (lambda s: s["effects"][0].update(gain=True), "gain must be a finite number; got True"),
    "ends": (lambda s: s["effects"][0].update(interval=[1]), "two words; got [1.0]. Run"),
    "order": (lambda s: s["effects"][0].update(interval=[2, 1]), "two words; got [2.0, 1.0]."),
    "mixed": (lambda s: s["effects"][0].update(interval=["a", 1]), "two words; got ['a', 1.0]."),
    "side": (lambda s: s["left"].update(up={}), "arm must be one of ('image', 'depth', 'whole'); "),
    "left": (lambda s: s["left"]["image"].pop("below"), "left.image must have the key below; got"),
    "howfar": (lambda s: s.update(howfar={"a": {}}), "howfar.a must have the key closed_pct; got"),
    "share": (lambda s: s["howfar"].update(a={"closed_pct": "b"}), "a finite number; got 'b'."),
    "baseline": (lambda s: s.update(baselines={"cosine": 1}), "cosine must be a name; got 1. Run"),
    "seconds": (lambda s: s.update(seconds=-1), "verdict.seconds must be >= 0; got -1.0. Run"),
}


@pytest.mark.parametrize(("damage", "words"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_verdicts_are_refused(
    damage: Callable[[dict[str, Any]], Any],
    words: str,
) -> None:
    table = make_verdict("effects", make_effect("lens_blur"))
    damage(table)
    with pytest.raises(WithheldError) as caught:
        verdict.from_table(table)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", [None, "{", "\xff"])
def test_unreadable_files_are_refused(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(WithheldError, match="verdict must be a readable JSON file; got"):
        verdict.read(path)


def test_an_error_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "seven.json"
    path.write_text("[]")
    with pytest.raises(WithheldError, match=r"^seven\.json must be an object; got \[\]\. Run"):
        verdict.read(path)
