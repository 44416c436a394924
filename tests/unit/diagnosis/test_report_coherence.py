"""The coherence split in the report: picture, table, sentences, and keys of report.json."""

from __future__ import annotations

import dataclasses
import json

import pytest

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import figures, first_answer, notes
from starling.diagnosis.report.page import page
from starling.diagnosis.where.coherence.shares import (
    CoherenceSplit,
    DisparityShares,
    Estimate,
    ImageShares,
    RoomShares,
)
from starling.sim.console import record
from tests.unit.diagnosis.made_diagnosis import FULL
from tests.unit.diagnosis.read_page import Reader

# Keys may be added. Programs read these, so they keep their names.
WHERE_KEYS = {
    "parts", "rules", "rows", "off", "maps", "frames", "levels", "bodies", "coherence",
}  # fmt: skip
IMAGE_KEYS = {
    "band", "power", "explained", "pattern", "camera", "scene", "unseparated", "imager", "noise",
    "coherent", "gain", "simulated_noise", "noise_ratio",
}  # fmt: skip
ROOM_KEYS = {
    "windows", "shift_px", "explained", "pattern", "camera", "scene", "unseparated", "imager",
    "noise", "coherent", "noise_ratio",
}  # fmt: skip
DISPARITY_KEYS = {"band", "rms_px", "camera", "image", "rest"}


def known(value: float) -> Estimate:
    return value, value - 0.05, value + 0.05


def images(band: str, *, power: float, explained: float) -> ImageShares:
    rest = 1 - explained
    return ImageShares(
        band=band,
        power=known(power),
        explained=known(explained),
        pattern=known(0.25 * rest),
        camera=known(-0.01 * rest),
        scene=known(0.66 * rest),
        unseparated=(0.0, None, None),
        imager=known(0.02 * rest),
        noise=known(0.08 * rest),
        coherent=known(0.9),
        gain=known(1.1),
        simulated_noise=known(0.1),
        noise_ratio=known(1.53),
    )


def disparity(band: str) -> DisparityShares:
    return DisparityShares(
        band=band,
        rms_px=known(0.2),
        camera=known(0.35),
        image=known(0.05),
        rest=known(0.6),
    )


ROOM = RoomShares(
    windows=120,
    shift_px=(0.2, -0.1),
    explained=0.5,
    pattern=0.1,
    camera=0.02,
    scene=0.3,
    unseparated=0.0,
    imager=0.03,
    noise=0.05,
    coherent=0.84,
    noise_ratio=1.4,
)
SPLIT = CoherenceSplit(
    images=(
        images("4-8 px", power=0.3, explained=0.9),
        images("16-33 px", power=0.7, explained=0.2),
        images("all", power=1.0, explained=0.41),
    ),
    rooms={"<attic>": ROOM},
    edges=dict.fromkeys(("real", "simulated", "gap"), known(0.4)),
    disparity=dict.fromkeys(("real", "simulated", "gap"), (disparity("> 64 px"), disparity("all"))),
)


def diagnosis_with(split: CoherenceSplit) -> Diagnosis:
    return dataclasses.replace(FULL, where=dataclasses.replace(FULL.where, coherence=split))


WITH_SPLIT = diagnosis_with(SPLIT)
SENTENCES = [
    "On surfaces, simulated captures explain 41 % (95 %: 36 to 46) of the image power of real "
    "captures.",
    "Of the unexplained power, 90 % (95 %: 85 to 95) is common to both imagers.",
    "Between rooms, 25 % of the unexplained power repeats in the projector field, 0 % in the "
    "camera image, 66 % in neither: texture, light.",
    "Most unexplained power has periods of 16-33 px.",
    "The power of single imagers, mostly noise, is 1.53 times as large in simulated captures "
    "(95 %: 1.48 to 1.58).",
    "Of the squared disparity gap, 40 % (95 %: 35 to 45) lies near depth edges.",
    "On surfaces, 35 % of it repeats in the camera image, 5 % follows the image.",
]


def test_the_split_is_said_in_sentences() -> None:
    assert first_answer.coherence_sentences(SPLIT, None) == SENTENCES
    assert notes.notes(WITH_SPLIT)[: len(SENTENCES)] == SENTENCES
    assert all(len(sentence.split()) <= 25 for sentence in SENTENCES)
    against = first_answer.coherence_sentences(SPLIT, "another set")
    assert "the other captures explain 41 %" in against[0]


def test_the_first_answer_has_the_stage_ablation() -> None:
    sentences = first_answer.first_answer(WITH_SPLIT.where, None)
    assert sentences[: len(SENTENCES)] == SENTENCES
    assert "points" in sentences[-1] and "from matcher and filters." in sentences[-1]
    assert not first_answer.coherence_sentences(CoherenceSplit(), None)


def test_sentences_leave_out_what_is_unknown() -> None:
    every_period = SPLIT.images[-1]
    together = dataclasses.replace(
        every_period, unseparated=(0.9 * 0.59, None, None), explained=(0.41, None, None)
    )
    lines = first_answer.coherence_sentences(CoherenceSplit(images=(together,)), None)
    assert lines[0] == (
        "On surfaces, simulated captures explain 41 % of the image power of real captures."
    )
    assert not any("projector" in line for line in lines)
    complete = dataclasses.replace(every_period, explained=(1.0, None, None))
    assert len(first_answer.coherence_sentences(CoherenceSplit(images=(complete,)), None)) == 1


def test_the_split_is_the_first_picture_of_where() -> None:
    text = page(WITH_SPLIT)
    read = Reader(text).text
    part = read[read.index("Coherence: what is missing") : read.index("Pipeline segments")]
    assert all(sentence in part for sentence in SENTENCES)
    assert part.index("All periods") < part.index("Period 16-33 px") < part.index("<attic>")
    assert "explained 41 %, noise ratio 1.53" in part
    assert "texture and light: repeats in neither" in part
    assert 'aria-label="explained by simulated captures 41 %' in text
    for title in ("Real", "Simulated", "Real minus simulated"):
        assert title in part
    row = Reader(text).row("All periods")
    assert row[2] == "41.0 % [36.0, 46.0]" and row[6] == "1.53 [1.48, 1.58]"


def test_missing_parts_of_the_split_are_not_shown() -> None:
    without = Reader(page(FULL)).text
    assert "No scene has 8 windows of 64 px without depth edges" in without
    assert "Infrared images</h4>" not in page(FULL)
    depth_only = page(diagnosis_with(dataclasses.replace(SPLIT, images=(), rooms={})))
    assert "Squared disparity errors" in depth_only and "Infrared images</h4>" not in depth_only
    images_only = page(diagnosis_with(dataclasses.replace(SPLIT, disparity={}, edges={})))
    assert "Squared disparity errors" not in images_only


@pytest.mark.parametrize(
    ("path", "keys"),
    [
        ((), WHERE_KEYS),
        (("coherence",), {"images", "rooms", "edges", "disparity"}),
        (("coherence", "images", 0), IMAGE_KEYS),
        (("coherence", "rooms", "<attic>"), ROOM_KEYS),
        (("coherence", "disparity"), {"real", "simulated", "gap"}),
        (("coherence", "disparity", "gap", 0), DISPARITY_KEYS),
        (("coherence", "edges"), {"real", "simulated", "gap"}),
    ],
)
def test_keys_of_the_json_are_kept(path: tuple[str | int, ...], keys: set[str]) -> None:
    content = json.loads(record.dumps(figures.figures(WITH_SPLIT)))["where"]
    for step in path:
        content = content[step]
    assert keys <= content.keys()


def test_the_json_holds_estimates_with_intervals() -> None:
    content = json.loads(record.dumps(figures.figures(WITH_SPLIT)))["where"]["coherence"]
    assert content["images"][-1]["explained"] == pytest.approx([0.41, 0.36, 0.46])
    assert content["images"][-1]["unseparated"] == [0.0, None, None]
    assert content["rooms"]["<attic>"]["shift_px"] == [0.2, -0.1]
