"""The sentence that says what to do next, the captions, and the maps of the remainder."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.remainder import Remainder
from starling.diagnosis.report import figures, notes, sentences
from starling.diagnosis.report.page import page
from starling.diagnosis.where.maps import CAMERA, COLUMNS, ROWS, GapMap
from starling.diagnosis.where.remainder import RemainderPlace
from starling.diagnosis.which.discrimination import SEPARATED, Discrimination
from starling.sim.console import record
from tests.unit.diagnosis.made_diagnosis import (
    FULL,
    NAMED,
    NOTHING,
    diagnosis,
    segment_result,
    surrogate,
)
from tests.unit.diagnosis.read_page import Reader

WEAK = dataclasses.replace(
    NOTHING, alone=NAMED.alone[:1], unexplained=np.full_like(NOTHING.unexplained, 3.0)
)
NONE = surrogate(segments=(segment_result(NOTHING),), evidence={})


def levels(ratio: float) -> Any:
    return dataclasses.replace(FULL.where, levels={"hall": ratio})


def separated(deviations: float) -> tuple[Discrimination, ...]:
    pair = ("pitch", "roll")
    return (Discrimination(capture="a lens cap on", rivals=pair, deviations=deviations),)


@pytest.mark.parametrize(
    "each, text",
    [
        (diagnosis(kind="cannot tell"), "Capture at least two rooms."),
        (
            surrogate(kind="no gap", segments=(segment_result(NOTHING),), evidence={}),
            "Nothing has to be changed; the report lists how strong an effect must be to show.",
        ),
        (
            diagnosis(discriminations=separated(SEPARATED)),
            "Capture a lens cap on, to separate pitch from roll.",
        ),
        (
            dataclasses.replace(
                NONE, where=levels(1.0), discriminations=separated(SEPARATED), restricted=True
            ),
            "Run this diagnosis with all families of effects; others were not tried.",
        ),
        (
            diagnosis(discriminations=separated(SEPARATED - 0.01)),
            "Run this diagnosis with --fix, then again with the sensor.toml that it writes.",
        ),
        (
            dataclasses.replace(NONE, where=levels(1.8)),
            "Check the exposure of the captures and of the sensor file, and diagnose again.",
        ),
        (
            surrogate(segments=(segment_result(WEAK),), evidence={}, where=levels(1.0)),
            f"Capture more rooms, so that {NAMED.alone[0].name} can be confirmed or excluded.",
        ),
        (
            dataclasses.replace(NONE, where=levels(1.0)),
            "Look for the cause in the maps of the gap; no known effect is like it.",
        ),
    ],
)
def test_the_next_step_follows_from_the_result(each: Diagnosis, text: str):
    assert sentences.next_step(each) == text
    assert json.loads(record.dumps(figures.figures(each)))["next"] == text


@pytest.mark.parametrize(("restricted", "word"), [(True, "tried"), (False, "known")])
def test_an_answer_without_effects_says_which_were_tried(restricted: bool, word: str):
    weak = surrogate(segments=(segment_result(WEAK),), evidence={}, restricted=restricted)
    assert f"each {word} effect is too weak to name" in sentences.answer(weak)[1]
    nothing = dataclasses.replace(NONE, restricted=restricted)
    assert sentences.answer(nothing)[1] == f"There is a gap, but no {word} effect reduces it."
    closest = surrogate("misfit", restricted=restricted)
    assert sentences.answer(closest)[1].startswith(f"No {word} effect explains the gap; ")


def test_effects_of_the_scene_belong_to_its_file():
    text = "Set motion in scene.toml, and diagnose again."
    assert sentences.next_step(diagnosis(settings={"motion": 1.0})) == text
    both = diagnosis(settings={"motion": 1.0, "pitch": 1.0})
    assert (
        sentences.next_step(both)
        == "Run this diagnosis with --fix, then again with the sensor.toml that it writes."
    )


def test_the_page_says_the_next_step():
    assert (
        "Run this diagnosis with --fix, then again with the sensor.toml that it writes."
        in Reader(page(FULL)).text
    )


def test_captions_name_the_effects_of_the_simulation():
    (name,) = NAMED.settings
    text = Reader(page(FULL)).text
    assert "Simulated, your sensor file: left infrared" in text
    assert f"Simulated, with {name} {sentences.with_unit(name, NAMED.settings[name])}: left" in text
    many = dict.fromkeys(("pitch", "gamma", "veil", "roll"), 0.9)
    assert sentences.applied(diagnosis(settings=many)) == (
        f"with pitch {sentences.with_unit('pitch', 0.9)}, gamma 0.9, veil 0.9 and 1 more"
    )


@pytest.mark.parametrize("fitted", [{"pattern_scale": 1.01}, {"ambient": 0.1}, {}])
def test_pictures_say_that_reflectance_is_estimated(fitted: dict[str, float]):
    each = diagnosis(fitted={FULL.example.scene: fitted})
    said = "Its reflectance is estimated from its images" in Reader(page(each)).text
    assert said == ("pattern_scale" in fitted)


def remainder_map() -> GapMap:
    values = np.full((ROWS, COLUMNS), 0.2)
    return GapMap(
        quantity="infrared", frame=CAMERA, mean=values, deviations=values, agreement=np.ones(3)
    )


def test_maps_of_the_remainder_are_drawn_and_recorded():
    place = RemainderPlace(frame="camera", zone=None, scale=None, maps=(remainder_map(),))
    each = diagnosis(places={"image": place})
    html = Reader(page(each))
    assert "Maps of the remainder" in html.text
    assert "log ratio of real to simulated with the reported effects" in html.text
    assert len(html.pictures) == len(Reader(page(diagnosis())).pictures) + 2  # Map and scale.
    assert "Maps of the remainder" not in page(diagnosis())
    (written,) = json.loads(record.dumps(figures.figures(each)))["which"]["image"]["remainder"][
        "maps"
    ]
    assert written["mean"][0][0] == 0.2


@pytest.mark.parametrize("share, located", [(0.05, True), (0.049, False)])
def test_a_tiny_remainder_is_not_located(share: float, located: bool):
    left = {"image": Remainder(share=share, interval=None)}
    segment = segment_result(NAMED, leads=(("level",), ()))
    each = diagnosis(segments=(segment,), remainders=left)
    (item,) = notes.note_lists(each)["Unexplained remainder"]
    assert left["image"].notable == located
    assert ("Features that show it: brightness." in item) == located
