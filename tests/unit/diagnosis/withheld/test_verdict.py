"""Verdicts: what a diagnosis wrote is read, and what is damaged is refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import verdict

Make = Callable[..., dict[str, Any]]


def test_a_verdict_is_read(effect: Make, say: Make, tmp_path: Path) -> None:
    weak = effect("second_projector.x", "left", gain=3.0, arm="depth")
    strong = effect("lens_blur", 0.8, "dot_blur", "corner_blur", "dot_blur", gain=30)
    path = tmp_path / "verdict.json"
    path.write_text(json.dumps(say("effects", weak, strong, cosine="dot_blur", random=None)))
    read = verdict.read(path)
    assert read.kind == "effects" and read.said == "lens_blur"
    assert [one.name for one in read.named] == ["lens_blur", "second_projector.x"]
    first, second = read.named
    assert (first.value, first.interval) == (0.8, (0.7000000000000001, 0.9))
    assert first.rows == {"lens_blur", "dot_blur", "corner_blur"}
    assert (second.row, second.value, second.arm) == ("second_projector", "left", "depth")
    assert read.baselines == {"cosine": "dot_blur", "random": None}
    assert read.seconds == 2.0


def test_a_set_is_of_effects_whatever_their_parameters(effect: Make, say: Make) -> None:
    alike = effect("second_projector.x", "left", "second_projector.power", "veil")
    read = verdict.from_table({**say("effects", alike), "seconds": 0})
    assert read.named[0].rows == {"second_projector", "veil"}
    assert read.seconds == 0.0


def test_stand_ins_are_not_named(effect: Make, say: Make) -> None:
    read = verdict.from_table(say("none of the known", effect("lens_blur")))
    assert read.effects and not read.named and read.first is None
    assert read.said == "none of the known"


def test_headline_is_that_of_the_first_effects_arm(effect: Make, say: Make) -> None:
    said = say("effects", effect("median", 3, arm="depth"), closed=20.0)
    assert verdict.from_table(said).headline_pct is None
    said["howfar"]["features of the depth"] = {"closed_pct": None}
    assert verdict.from_table(said).headline_pct is None
    said["howfar"]["features of the depth"] = {"closed_pct": 70.0}
    assert verdict.from_table(said).headline_pct == 70.0
    assert verdict.from_table(say("no gap", metric="ndp_brier")).headline_pct is None


def test_nothing_is_closed_by_what_an_arm_does_not_name(effect: Make, say: Make) -> None:
    """What a filter of the other arm closes is not the image's."""
    said = say("effects", effect("median", 3, arm="depth"), closed=20.0)
    said["left"]["image"] = said["left"]["depth"]
    said["howfar"]["features of the depth"] = {"closed_pct": 88.0}
    read = verdict.from_table(said)
    assert read.headline_pct == 88.0 and read.of_arm("image").headline_pct is None


def test_one_arm_is_taken_alone(effect: Make, say: Make) -> None:
    """A gap of matcher and filters leaves the image without one, and the other way round."""
    said = say("none of the known", effect("median", 3, arm="depth"), effect("veil", gain=3.0))
    said["left"]["image"]["beyond"] = 0.2
    said["left"]["depth"]["beyond"] = 1.2
    read = verdict.from_table(said)
    image, depth = read.of_arm("image"), read.of_arm("depth")
    assert image.kind == "effects" and [one.name for one in image.named] == ["veil"]
    assert depth.kind == "none of the known" and [one.name for one in depth.effects] == ["median"]
    said["baselines_by_arm"]["depth"] = {"cosine": "veil"}
    assert verdict.from_table(said).of_arm("depth").baselines == {"cosine": "veil"}
    said["left"]["depth"]["beyond"] = said["left"]["depth"]["below"]
    assert verdict.from_table(said).of_arm("depth").kind == "effects"  # As much is explained.
    alone = verdict.from_table(say("effects", effect("median", 3, arm="depth")))
    assert alone.of_arm("image").kind == "no gap"
    with pytest.raises(WithheldError, match=r"arm must be one of \['depth', 'image'\]; got whole"):
        read.of_arm("whole")


DAMAGE: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no verdict": (lambda s: s.pop("verdict"), "verdict must have the key verdict; got ['base"),
    "kind": (lambda s: s.update(verdict="fine"), "verdict.verdict must be one of ('effects', "),
    "no list": (lambda s: s.update(effects={}), "verdict.effects must be a list; got {}. Let"),
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
    "ends": (lambda s: s["effects"][0].update(interval=[1]), "two words; got [1.0]. Let"),
    "order": (lambda s: s["effects"][0].update(interval=[2, 1]), "two words; got [2.0, 1.0]."),
    "mixed": (lambda s: s["effects"][0].update(interval=["a", 1]), "two words; got ['a', 1.0]."),
    "side": (lambda s: s["left"].update(up={}), "arm must be one of ('image', 'depth', 'whole'); "),
    "left": (lambda s: s["left"]["image"].pop("below"), "left.image must have the key below; got"),
    "howfar": (lambda s: s.update(howfar={"a": {}}), "howfar.a must have the key closed_pct; got"),
    "share": (lambda s: s["howfar"].update(a={"closed_pct": "b"}), "a finite number; got 'b'."),
    "baseline": (lambda s: s.update(baselines={"cosine": 1}), "cosine must be a name; got 1. Let"),
    "seconds": (lambda s: s.update(seconds=-1), "verdict.seconds must be >= 0; got -1.0. Let"),
}


@pytest.mark.parametrize(("damage", "words"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_verdicts_are_refused(
    damage: Callable[[dict[str, Any]], Any], words: str, effect: Make, say: Make
) -> None:
    said = say("effects", effect("lens_blur"))
    damage(said)
    with pytest.raises(WithheldError) as caught:
        verdict.from_table(said)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", [None, "{", "\xff"])
def test_unreadable_files_are_refused(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(WithheldError, match="verdict must be a readable JSON file; got"):
        verdict.read(path)


def test_a_refusal_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "seven.json"
    path.write_text("[]")
    with pytest.raises(WithheldError, match=r"^seven\.json must be an object; got \[\]\. Let"):
        verdict.read(path)
