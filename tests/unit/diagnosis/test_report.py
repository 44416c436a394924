"""The report page of small, constructed diagnoses: sentences, numbers, pictures."""

from __future__ import annotations

import base64
import dataclasses
import json
import re

import cv2
import numpy as np
import pytest

from starling.diagnosis import command
from starling.diagnosis.report import figures, notes, sentences
from starling.diagnosis.report.page import page
from starling.diagnosis.where import maps, rules, swap
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.discrimination import Discrimination
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.sensitivity import DetectionLimit
from starling.sim.console import record
from tests.unit.diagnosis.made_diagnosis import (
    FULL,
    HOWFAR,
    MINUS,
    NAMED,
    NAMES,
    NAN,
    NOTHING,
    diagnosis,
    real,
    segment_result,
    surrogate,
)
from tests.unit.diagnosis.read_page import Reader


def test_page_is_self_contained():
    text = page(FULL)
    read = Reader(text)
    assert not read.tags & {"script", "link", "iframe", "object"}
    assert not re.search(r"(?:src|href)=\"(?!data:image/png;base64,|#)", text)
    assert "http" not in text and len(text) < 4_000_000
    for picture in read.pictures:
        data = base64.b64decode(picture["src"].partition(",")[2], validate=True)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None and image.size
    alternatives = [picture["alt"] for picture in read.pictures if picture["alt"]]
    # Three quantities in two frames; three images, their middles and three error maps of one scene.
    assert len(alternatives) == len(set(alternatives)) == 6 + 9


def test_answer_comes_first():
    text = Reader(page(FULL)).text
    head = text[: text.index("Pipeline segments")]
    for sentence in sentences.answer(FULL):
        assert re.sub(r"\s+", " ", sentence) in head
    assert "Consistent with known effects" in head
    assert "Effects are selected on attic, hall, kitchen" in head
    assert "Effects are evaluated on <b>cellar</b> & yard." in head


def test_names_are_escaped():
    text = page(dataclasses.replace(FULL, limits=("One <i>frame</i> a scene & no more.",)))
    assert "<b>cellar</b>" not in text and "&lt;b&gt;cellar&lt;/b&gt; &amp; yard" in text
    assert "<i>frame" not in text and "One &lt;i&gt;frame" in text


def test_stage_ablation_shows_the_figures():
    read = Reader(page(FULL))
    rate = FULL.where.parts["ndp_rate"]
    assert rate.device is not None and rate.base is not None and rate.image is not None
    assert f"A simulated {100 * rate.base:.2f} %" in read.text
    assert f"C device {100 * rate.device:.2f} %" in read.text
    mean, low, high = (f"{100 * end:+.2f}" for end in rate.image)
    assert f"B minus A: images {mean} [{low}, {high}] points" in read.text


def test_bins_with_smallest_p_values_are_listed():
    read = Reader(page(FULL))
    rows = FULL.where.hole_bins
    assert len(rows) > 15
    for number, row in enumerate(rows):
        listed = [cells for cells in read.rows if cells[:2] == [row.covariate, row.bin]]
        assert len(listed) == (number < 15)
        if listed:
            assert listed[0][2] == f"{100 * row.gap:+.2f} points".replace("-", MINUS)
            assert listed[0][6] == f"{row.p:.3g}"


def test_wrong_depth_has_its_own_table():
    rows = FULL.where.hole_bins
    changed = dataclasses.replace(
        FULL, where=dataclasses.replace(FULL.where, hole_bins=(), error_bins=rows)
    )
    head = ["Covariate", "Bin", "Gap in errors"]
    read = Reader(page(changed)).rows
    first = next(number for number, row in enumerate(read) if row[:3] == head) + 1
    listed = [row[:2] for row in read[first : first + 9]]
    assert listed[:8] == [[row.covariate, row.bin] for row in rows[:8]]
    assert listed[8:] != [[rows[8].covariate, rows[8].bin]]
    assert len(figures.figures(changed)["where"]["off"]) == len(rows)


def test_rules_are_sentences():
    rule = rules.GapRule(text="level < 12 DN", gap=-0.051, area=0.034, net=-0.0017, share=0.41)
    unknown = dataclasses.replace(rule, text="x > 3 px", gap=0.02, share=NAN)
    text = Reader(
        page(
            dataclasses.replace(FULL, where=dataclasses.replace(FULL.where, rules=(rule, unknown)))
        )
    ).text
    assert (
        "Where level < 12 DN, real captures have 5.1 points fewer pixels without depth than "
        "simulated captures; this is 3.4 % of the pixels and 41 % of the whole gap." in text
    )
    assert "2.0 points more pixels without depth than simulated captures; this is 3.4 %" in text
    none = dataclasses.replace(FULL.where, rules=())
    assert "No rule" in page(dataclasses.replace(FULL, where=none))


def test_accepted_effects_show_value_interval_and_credible_set():
    (effect,) = NAMED.accepted
    assert effect.rivals
    read = Reader(page(FULL))
    (row,) = [cells for cells in read.rows if cells[:1] == [effect.fit.name] and len(cells) == 7]
    assert row[1] == sentences.number(effect.fit.value)
    assert row[2] == "[{}, {}]".format(*map(sentences.number, effect.interval))
    assert row[5:] == [f"{effect.fit.total:.1f}", "effect"]
    rival = effect.rivals[0]
    ends = ", ".join(map(sentences.number, effect.rival_intervals[0]))
    text_expected = (
        f"{effect.fit.name} is not separable from {rival.name} {sentences.number(rival.value)} "
    )
    assert f"{text_expected}[{ends}]" in re.sub(" +", " ", read.text)
    alone = {"lens_blur", "dot_blur"}
    for fit in NAMED.alone:
        shown = f"{fit.name} {fit.total:.1f} at {sentences.number(fit.value)}" in read.text
        assert shown == (fit.total > 0) and (shown or fit.name not in alone)


def test_absorbed_effects_are_not_separable_from_estimates():
    (effect,) = NAMED.accepted
    rivals = [rival.name for rival in effect.rivals]
    taken = dataclasses.replace(FULL, absorbed=(effect.fit.name,))
    assert rivals and f"{effect.fit.name} is not separable from {sentences.ESTIMATED}." in (
        notes.notes(taken)
    )
    alone = dataclasses.replace(effect, rivals=(), rival_intervals=())
    bare = dataclasses.replace(NAMED, accepted=(alone,))
    text = Reader(page(dataclasses.replace(taken, segments=(segment_result(bare),)))).text
    assert f"{effect.fit.name} is not separable from reflectance and light" in text
    assert "is separable from the other effects" not in text
    assert [effect["taken_up"] for effect in figures.figures(taken)["effects"]] == [True]
    assert [effect["taken_up"] for effect in figures.figures(FULL)["effects"]] == [False]


def test_no_cause_is_claimed():
    unknown = surrogate("rival", segments=(segment_result(NAMED, leads=(("level",), ())),))
    for each in (FULL, unknown):
        assert not re.search(r"caused? by|because of", Reader(page(each)).text)


def test_separating_capture_is_proposed():
    near = Discrimination(capture="a lens cap on", rivals=("a", "b"), deviations=1.25)
    far = Discrimination(capture="8 repeats", rivals=("x, c", "x, d"), deviations=12.0)
    of_both = diagnosis(discriminations=(near, far))
    text = Reader(page(of_both)).text
    differ = "the predictions differ by 12.0 standard deviations."
    assert f"c or d (both with x): take 8 repeats; {differ}" in text
    assert "a or b: no capture that was tried separates them reliably. The best, a lens cap" in text
    assert "Captures that would separate" not in page(FULL)
    assert [each["enough"] for each in figures.figures(of_both)["tell_apart"]] == [False, True]


def test_gap_reduction_shows_the_figures():
    text = Reader(page(FULL)).text
    assert "before 0.25 after 0.125 floor 0.0625" in text
    assert "Gap reduction 67 %, 95 % interval [41, 83] %." in text
    assert f"Gap reduction {MINUS}200 %; fewer than three rooms give no interval." in text
    assert f"before {MINUS}2.5 after {MINUS}3.5 floor {MINUS}3" in text
    assert "Not identifiable" in text and "before \N{EN DASH} after" in text
    assert "lens_blur 81 %" in text
    assert (
        "On 1 held-out scene, the reported effects close 67 % (95 %: 41 to 83) of the gap in holes "
        "(Brier score)." in text
    )
    assert "By itself, lens_blur closes 80 % of the gap in holes (Brier score)." in text
    assert "On 2 held-out scenes" in page(diagnosis(held_out=NAMES[:2]))


def test_gap_reductions_share_one_chart():
    """The axis runs from -50, where the bar of -200 is clipped, to the line at 100."""
    read = page(FULL).split("All figures")[1].split("</ul>")[0]
    assert "Holes: Brier score" in read and f"{MINUS}200 %" in read and "bias" not in read
    assert read.count('"whisker"') == 1
    left, width = re.findall(r'"whisker" style="left:([\d.]+)%;width:([\d.]+)%"', read)[0]
    assert float(left) == pytest.approx(100 * 91 / 150, abs=0.01)
    assert float(width) == pytest.approx(100 * 42 / 150, abs=0.01)
    none = {name: HOWFAR.figures[name] for name in ("bias_px", "log_nmad")}
    result = dataclasses.replace(HOWFAR, figures=none)
    assert "All figures" not in page(dataclasses.replace(FULL, howfar=result))


def test_no_gap_is_a_verdict():
    no_gap = diagnosis(kind="no gap", segments=(segment_result(NOTHING),), howfar=None)
    text = Reader(page(no_gap)).text
    assert "No gap found" in text and "No effect is accepted here." in text
    assert "No effect has a positive gain." in text
    assert "This scene is held out: it was not used to select the effects." in text
    assert "There is no gap to close." in text
    assert "is not separable" not in text.split("How this report was made")[1]
    assert "the remaining gap. It" not in text
    assert "Detection limits" not in text


def test_detection_limits_are_shown_without_a_gap():
    seen = (
        DetectionLimit(name="vignetting", base=0.0, below=None, above=0.75),
        DetectionLimit(name="gamma", base=1.0, below=0.9, above=1.25),
    )
    no_gap = diagnosis(
        kind="no gap", segments=(segment_result(NOTHING),), howfar=None, sensitivities=seen
    )
    read = Reader(page(no_gap))
    assert "Detection limits" in read.text
    assert read.row("vignetting") == ["vignetting", "", "0", "0.75", ""]
    assert read.row("gamma")[1:4] == ["0.9", "1", "1.25"]
    result = json.loads(record.dumps(figures.figures(no_gap)))["noticed"]
    assert result[0] == {"name": "vignetting", "base": 0.0, "below": None, "above": 0.75}


def leading(*groups: str) -> SegmentResult:
    """Return a segment of device depth whose accepted effect leaves a gap."""
    unexplained = np.full_like(NAMED.unexplained, 3.0)
    search = dataclasses.replace(NAMED, unexplained=unexplained)
    return segment_result(search, segment=Segment.DEPTH, leads=(groups, ()))


def test_surrogates_alone_are_a_verdict_with_leads():
    each = surrogate("misfit", "held out", segments=(leading("pair by x", "level"),))
    name = NAMED.accepted[0].fit.name
    read = Reader(page(each))
    assert "No known effect explains the gap" in read.text
    assert "In the device's matcher and filters" in read.text
    assert (
        "No known effect explains the remainder. It shows in difference of right and left image, "
        "by x, brightness." in read.text
    )
    assert f"{name} comes closest, but {sentences.REASONS['misfit']}." in sentences.answer(each)[1]
    for reason in ("misfit", "held out"):
        assert f"{name} is called a surrogate: {sentences.REASONS[reason]}." in notes.notes(each)
    assert "Surrogates" in notes.note_lists(each) and "Effects" not in notes.note_lists(each)
    (row,) = [cells for cells in read.rows if cells[:1] == [name] and len(cells) == 7]
    assert row[6] == "surrogate" and "Consistent with" not in read.text.split("Which effects")[0]
    assert "no improvement is claimed." in sentences.answer(each)[2]
    assert "the remainder. It" not in Reader(page(FULL)).text


def test_lead_names_the_fixed_frame():
    agree = {maps.CAMERA: np.array([0.1, 0.1, 0.1]), maps.PROJECTOR: np.array([0.9, 0.9, 1.0])}
    drawn = tuple(
        dataclasses.replace(each, agreement=agree[each.frame] * (each.quantity == "error"))
        for each in FULL.where.maps
    )
    somewhere = dataclasses.replace(FULL.where, maps=drawn)
    each = surrogate("misfit", segments=(leading("level"),), where=somewhere)
    text_expected = "brightness (without any effect, its location is fixed in the projector field)."
    assert text_expected in Reader(page(each)).text
    assert "Rooms do not agree on its location." in Reader(page(each)).text
    result = json.loads(record.dumps(figures.figures(each)))
    assert result["which"]["depth"]["frame"] == result["where"]["frames"]["error"] == "projector"
    assert result["where"]["frames"]["holes"] is None


def test_unidentifiable_is_a_verdict():
    each = diagnosis(
        real()[:1],
        kind="cannot tell",
        segments=(),
        held_out=(),
        howfar=None,
        limits=("One room alone: nothing can be held out, so no effect is named.",),
    )
    text = Reader(page(each)).text
    assert "These captures cannot identify the effect" in text
    assert "One room alone: nothing can" in text and "to select the effects" not in text
    assert "No effect was tried" in text and "Only one room: maps" in text
    assert "was not evaluated: no scene is held out" in text
    assert "Effects are selected on attic." in text and "No scene is held out" in text


def test_depth_only_captures_show_only_depth():
    read = Reader(
        page(
            diagnosis(
                real(infrared=False), segments=(segment_result(NAMED, segment=Segment.WHOLE),)
            )
        )
    )
    assert "In depth" in read.text and "not used to select the effects." in read.text
    assert "No infrared images of it were captured." in read.text
    assert "B real images, our matcher not captured" in read.text
    assert "Infrared level" not in read.text and "B minus A" not in read.text.split("Maps")[1]
    assert not any(each["alt"].startswith("Real: ") for each in read.pictures)
    assert any(each["alt"].startswith("Real, device depth: ") for each in read.pictures)


def test_our_matcher_replaces_missing_device_depth():
    read = Reader(page(diagnosis(real(device=False))))
    assert "C device not captured" in read.text and "C minus B: matcher" not in read.text
    assert any(each["alt"].startswith("Real, our matcher: ") for each in read.pictures)


def test_missing_simulation_after_has_no_picture():
    bare = dataclasses.replace(FULL.example, after=None)
    read = Reader(page(diagnosis(example=bare)))
    assert "there is no picture with effects" in read.text
    assert not any("reported effects" in each["alt"] for each in read.pictures)


def test_unknown_values_are_dashes():
    unknown = np.full((maps.ROWS, maps.COLUMNS), NAN)
    blank = tuple(
        dataclasses.replace(each, mean=unknown, deviations=unknown) for each in FULL.where.maps
    )
    parts = {
        "bias_px": swap.StageFigures(
            base=NAN, base_device=None, rematched=None, device=None, image=None, matcher=None
        ),
        "ndp_rate": FULL.where.parts["ndp_rate"],
    }
    row = dataclasses.replace(FULL.where.hole_bins[0], share=NAN, low=NAN)
    each = dataclasses.replace(FULL.where, parts=parts, maps=blank, hole_bins=(row,))
    read = Reader(page(dataclasses.replace(FULL, where=each)))
    assert "A simulated \N{EN DASH} px" in read.text
    assert (
        "Projector frame: too few pixels in every cell." in read.text
        and "nan" not in read.text.lower()
    )
    assert read.row(row.covariate, row.bin)[3:6:2] == ["\N{EN DASH}", "\N{EN DASH}"]


def test_json_holds_the_figures_of_the_page():
    result = json.loads(record.dumps(figures.figures(FULL)))
    assert result["verdict"] == "effects" and result["says"] == sentences.answer(FULL)
    assert result["howfar"]["log_nmad"]["before"] is None
    image = result["which"]["image"]
    assert image["by_group"]["level by x"]["after"] == pytest.approx(image["after"])
    (rival,) = NAMED.accepted[0].rivals
    assert result["effects"][0]["rival_gains"] == {rival.name: pytest.approx(rival.total)}
    low, high = result["effects"][0]["rival_intervals"][rival.name]
    assert low <= result["effects"][0]["rivals"][rival.name] <= high


def test_printed_text_ends_with_paths():
    result = {"says": ["a.", "b."], "notes": ["c."], "next": "d.", "report": "out/report.html"}
    result |= {"fixed": None, "not_in_sensor": []}
    lines = ["a.", "b.", "c.", "Next: d.", "Report: out/report.html"]
    assert command.as_text(result).splitlines() == lines
    result["fixed"] = "out/sensor.toml"
    assert command.as_text(result).splitlines() == [*lines, "Sensor: out/sensor.toml"]
    result["next"] = sentences.FIX
    assert "Next: Run this diagnosis again with the sensor file below." in command.as_text(result)
    result["not_in_sensor"] = ["ambient", "motion"]
    assert "Effects of the scene, not written to a sensor file: ambient, motion" in (
        command.as_text(result)
    )
